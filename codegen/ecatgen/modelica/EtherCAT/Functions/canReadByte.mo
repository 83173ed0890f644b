within EtherCAT.Functions;
impure function canReadByte "Byte of the last frame of a CAN message"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.CANMessage message "Message";
  input Real t "Simulation time";
  input Integer order "Any value whose computation must come before this call";
  input Integer number "Number of the byte, 1 first";
  output Integer y "Value, 0 to 255";
  external "C" y = ecatm_can_read_byte(message, t, order, number)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");

  annotation (Documentation(info = "<html>
<p>
Reads what the sample of this time has found, whichever block asked first; pass the <code>cycle</code> of
the EtherCATMaster as <code>order</code>. Call it in <code>when sampled</code>.
</p>
</html>"));
end canReadByte;
