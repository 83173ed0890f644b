within EtherCAT.Functions;
impure function masterState "State of the bus in the sample of this time"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.Master master "Connection";
  input Real t "Simulation time";
  input Integer order "Any value whose computation must come before this call";
  output Boolean connected "= true, if the sample is of a bus that delivers";
  output Real age "Time since the frames of the sample came back in s, 1e9 before the first exchange";
  output Integer missed "Bus cycles in addition to those that the model waited for";
  output EtherCAT.Types.BusState state "State of the bus";
  output Integer workingCounter "Sum of the working counters of all domains of the bus";
  output Integer workingCounterExpected "Working counter when all slaves take part";
  external "C" connected = ecatm_master_state(master, t, order, age, missed, state, workingCounter, workingCounterExpected)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");

  annotation (Documentation(info = "<html>
<p>
Takes no sample itself: pass the <code>cycle</code> of this time as <code>order</code>. The <a
href=\"modelica://EtherCAT.EtherCATMaster\">EtherCATMaster</a> has the results as outputs.
</p>
</html>"));
end masterState;
