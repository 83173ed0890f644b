within EtherCAT.Types;
type BusState = enumeration(
    Missing "No daemon serves the bus",
    StandsStill "The daemon is there, but exchanges nothing",
    Incomplete "Process data is exchanged, but not all slaves take part (working counter)",
    NotOperational "All slaves take part, but not all that the model uses are in OP",
    Operational "All slaves that the model uses are in OP") "State of a bus, as a model sees it"
  annotation (Documentation(info = "<html>
<p>
Output <code>state</code> of the <a href=\"modelica://EtherCAT.EtherCATMaster\">EtherCATMaster</a>. From
<code>Incomplete</code> on, values are those of a bus cycle.
</p>
</html>"));
