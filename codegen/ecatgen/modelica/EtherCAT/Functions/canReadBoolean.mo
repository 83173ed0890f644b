within EtherCAT.Functions;
impure function canReadBoolean "Value of a CAN signal in the last frame, as a Boolean"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.CANSignal signal "Signal";
  input Real t "Simulation time";
  input Integer order "Any value whose computation must come before this call";
  output Boolean y "Value";
  external "C" y = ecatm_can_read_boolean(signal, t, order)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");

  annotation (Documentation(info = "<html>
<p>
Bits times <code>scale</code> plus <code>offset</code> of the <a href=\"modelica://EtherCAT.Objects.CANSignal\">CANSignal</a>;
before the first frame, that of bits that are 0.
</p>
<p>
Reads what the sample of this time has found, whichever block asked first; pass the <code>cycle</code> of
the EtherCATMaster as <code>order</code>. Call it in <code>when sampled</code>.
</p>
</html>"));
end canReadBoolean;
