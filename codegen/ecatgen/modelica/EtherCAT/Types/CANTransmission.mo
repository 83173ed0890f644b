within EtherCAT.Types;
type CANTransmission = enumeration(
    OnChange "When its data change, and with a period also then",
    Periodic "Every period",
    EachSample "At every sample of the domain",
    OnTrigger "When the trigger changes") "When a CAN message is sent"
  annotation (Documentation(info = "<html>
<p>
The first frame leaves with the first sample, except that of <code>OnTrigger</code>. After an outage of the bus, and when
the terminal is back, messages leave at once, as at the start.
</p>
</html>"));
