within EtherCAT.Functions;
impure function slaveState "State of a slave in the sample of this time"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.SlaveConfiguration slaveConfiguration "Slave";
  input Real t "Simulation time";
  input Integer order "Any value whose computation must come before this call";
  output Boolean valid "= true, if its values are those of a cycle in which it took part in OP";
  output EtherCAT.Types.ALState alState "State of the slave";
  output Integer alStatusCode "AL status code, 0: no error";
  external "C" valid = ecatm_slave_state(slaveConfiguration, t, order, alState, alStatusCode)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");

  annotation (Documentation(info = "<html>
<p>
Reads from the image of all inputs that the sample of this time has taken, whichever block asked first; pass
the <code>cycle</code> of the EtherCATMaster as <code>order</code>. Call it in <code>when sampled</code>.
</p>
<p>
AL status codes are in ETG.1000.6.
</p>
</html>"));
end slaveState;
