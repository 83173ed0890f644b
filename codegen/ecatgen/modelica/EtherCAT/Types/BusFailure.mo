within EtherCAT.Types;
type BusFailure = enumeration(
    Error "The simulation ends with an error",
    Wait "The simulation waits until the bus is there",
    Continue "The simulation goes on with invalid values until the bus is there")
  "Reaction of a model to a missing bus"
  annotation (Documentation(info = "<html>
<p>
For the parameters <code>whenMissing</code> and <code>whenFailed</code> of the
<a href=\"modelica://EtherCAT.EtherCATMaster\">EtherCATMaster</a>. A bus with other slaves than the model
expects is always an error.
</p>
</html>"));
