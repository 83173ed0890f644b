within EtherCAT.Functions;
impure function commit "Hand the written values of a slave over to the bus, all at once"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.SlaveConfiguration slaveConfiguration "Slave";
  input Real t "Simulation time";
  input Integer order "Any value whose computation must come before this call";
  output Integer done "Equal to order";
  external "C" done = ecatm_commit(slaveConfiguration, t, order)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");

  annotation (Documentation(info = "<html>
<p>
Makes the model the owner of the outputs of the slave when it is called for the first time. The values of all slaves
of a domain leave together with the next cycle of the bus, when the last one of them has committed. Pass the
result of the last write as <code>order</code>. Committing twice at one time does no harm.
</p>
<p>
It is an error if another program owns one of the outputs, or if a value is out of the range of its entry.
</p>
</html>"));
end commit;
