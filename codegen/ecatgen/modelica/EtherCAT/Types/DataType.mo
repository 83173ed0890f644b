within EtherCAT.Types;
type DataType = enumeration(
    BOOLEAN "One byte, 0 or 1",
    INTEGER8 "8 bits, signed",
    UNSIGNED8 "8 bits, unsigned",
    INTEGER16 "16 bits, signed",
    UNSIGNED16 "16 bits, unsigned",
    INTEGER32 "32 bits, signed",
    UNSIGNED32 "32 bits, unsigned") "Integer data types of CoE objects"
  annotation (Documentation(info = "<html>
<p>The numbers of the elements are known to <code>ecat_modelica.h</code>.</p>
</html>"));
