within EtherCAT.Types;
type Request = enumeration(
    Triggered "When the trigger rises",
    Sampled "At the start, and then every period",
    Initial "Once, at the start") "When an object of a slave is requested"
  annotation (Documentation(info = "<html>
<p>
No request delays the simulation, not even one at the start: its answer comes some samples later.
</p>
</html>"));
