within EtherCAT.Objects;
class CANSignal "One signal of a CAN message"
  extends ExternalObject;

  function constructor "Register a signal"
    input EtherCAT.Objects.CANMessage message "Message";
    input String name "Name, for error messages";
    input Integer startBit "First bit: the lowest one, or with bigEndian the highest one, as in a DBC file";
    input Integer bitLength "Number of bits";
    input Boolean bigEndian "= true, if the first byte has the highest bits (Motorola)";
    input Integer number "What the bits are: number of the EtherCAT.Types.CANNumber";
    input Real scale "Value = bits * scale + offset";
    input Real offset "See scale";
    input Real minimum "Smallest value that can be sent";
    input Real maximum "Largest value that can be sent";
    input String unit "Unit of the value";
    input Integer selector[5] "Multiplexing: start bit, bits, 1 for big endian, lowest and highest value";
    output CANSignal signal "Signal";
    external "C" signal = ecatm_can_signal_open(message, name, startBit, bitLength, bigEndian, number, scale, offset, minimum, maximum, unit, selector)
      annotation (
        Include = "#include \"ecat_modelica.h\"",
        IncludeDirectory = "modelica://EtherCAT/Resources/Include",
        Library = "ecat",
        LibraryDirectory = "modelica://EtherCAT/Resources/Library");
  end constructor;

  function destructor "Release it"
    input CANSignal signal "Signal";
    external "C" ecatm_can_signal_close(signal)
      annotation (
        Include = "#include \"ecat_modelica.h\"",
        IncludeDirectory = "modelica://EtherCAT/Resources/Include",
        Library = "ecat",
        LibraryDirectory = "modelica://EtherCAT/Resources/Library");
  end destructor;

  annotation (Documentation(info = "<html>
<p>
Bit 0 is the lowest one of the first byte, bit 15 the highest one of the second. With a scale, an offset or a unit the
signal is an analog quantity: a value beyond its limits is cut to them, and not refused.
</p>
<p>
A multiplexed signal is in a frame only if another, unsigned signal of this frame has certain values:
<code>selector</code> has the place and these values. <code>{0, 0, 0, 0, 0}</code> means that all frames have it.
</p>
</html>"));
end CANSignal;
