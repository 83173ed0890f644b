within EtherCAT.Types;
type CANNumber = enumeration(
    Unsigned "Whole number without a sign",
    Signed "Whole number with a sign (two's complement)",
    Float "Floating-point number of 32 or 64 bits (IEEE 754)") "What the bits of a CAN signal are"
  annotation (Documentation(info = "<html>
<p>
The bits of a signal are such a number; the value is this number times <code>scale</code> plus <code>offset</code>.
</p>
</html>"));
