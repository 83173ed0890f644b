within EtherCAT.Functions;
impure function canWriteInteger "Note the value of a CAN signal for its message"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.CANSignal signal "Signal";
  input Real t "Simulation time";
  input Integer order "Any value whose computation must come before this call";
  input Integer u "Value";
  output Integer done "Equal to order";
  external "C" done = ecatm_can_write_integer(signal, t, order, u)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");

  annotation (Documentation(info = "<html>
<p>
The value leaves with <a href=\"modelica://EtherCAT.Functions.canSend\">canSend</a> of the message. Pass the result of the
write before, or the <code>cycle</code> of the EtherCATMaster, as <code>order</code>: so the calls have an order.
</p>
</html>"));
end canWriteInteger;
