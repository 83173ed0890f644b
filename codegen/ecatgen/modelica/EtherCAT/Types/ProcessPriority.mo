within EtherCAT.Types;
type ProcessPriority = enumeration(
    Idle "Only when nothing else wants to run (nice 19)",
    BelowNormal "Behind other programs (nice 10)",
    Normal "As the simulation was started",
    High "Before other programs (nice -20)",
    Realtime "Before all ordinary programs (SCHED_FIFO 40)") "Priority of the simulation process"
  annotation (Documentation(info = "<html>
<p>
High and Realtime need a right that ordinary users do not have: the limits <code>nice -20</code> and
<code>rtprio 40</code> in <code>/etc/security/limits.conf</code>. <code>ecatm_realtime.h</code> uses the numbers
of the elements.
</p>
</html>"));
