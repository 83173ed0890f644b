within EtherCAT.Types;
type ALState = enumeration(
    NotAvailable "The slave does not answer, or there is no bus",
    Init "INIT: no communication but registers",
    PreOp "PREOP: mailbox",
    Bootstrap "BOOT: firmware update",
    SafeOp "SAFEOP: mailbox and inputs, outputs are safe",
    Op "OP: mailbox, inputs and outputs") "State of a slave (application layer, ETG.1000.6)"
  annotation (Documentation(info = "<html>
<p>
Variable <code>alState</code> of the blocks of slaves. The AL status code, <code>alStatusCode</code>, says why a
slave has left OP; <code>ecatctl slaves</code> shows the reason in words.
</p>
</html>"));
