within EtherCAT.Types;
type DataType = enumeration(
    BOOLEAN "One byte, 0 or 1",
    INTEGER8 "8 bits, signed",
    INTEGER16 "16 bits, signed",
    INTEGER32 "32 bits, signed",
    UNSIGNED8 "8 bits, unsigned",
    UNSIGNED16 "16 bits, unsigned",
    UNSIGNED32 "32 bits, unsigned",
    REAL32 "Floating point, 32 bits",
    VISIBLE_STRING "Text",
    OCTET_STRING "Bytes",
    UNICODE_STRING "Text in UTF-16",
    TIME_OF_DAY "Not used by this library",
    TIME_DIFFERENCE "Not used by this library",
    Reserved14 "Not used by the standard",
    DOMAIN "Not used by this library",
    INTEGER24 "24 bits, signed",
    REAL64 "Floating point, 64 bits",
    INTEGER40 "40 bits, signed",
    INTEGER48 "48 bits, signed",
    INTEGER56 "56 bits, signed",
    INTEGER64 "64 bits, signed",
    UNSIGNED24 "24 bits, unsigned",
    Reserved23 "Not used by the standard",
    UNSIGNED40 "40 bits, unsigned",
    UNSIGNED48 "48 bits, unsigned",
    UNSIGNED56 "56 bits, unsigned",
    UNSIGNED64 "64 bits, unsigned") "Data types of CoE objects; Integer(dataType) is their number in CiA 301"
  annotation (Documentation(info = "<html>
<p>
The number of each element is the one that the type has in CiA&nbsp;301 and ETG.1000.6 (\"Data type
area\"), so that <code>Integer(dataType)</code> is what documentation of slaves and
<code>ecatctl</code> show. BYTE, WORD and DWORD are read and written as <code>UNSIGNED8</code>,
<code>UNSIGNED16</code> and <code>UNSIGNED32</code>.
</p>
<table border=\"1\" cellspacing=\"0\" cellpadding=\"2\">
<tr><th>blocks</th><th>data types</th></tr>
<tr><td><a href=\"modelica://EtherCAT.SDORead\">SDORead</a>,
<a href=\"modelica://EtherCAT.SDOWrite\">SDOWrite</a></td>
<td>all integers; a value must lie between -2^31 and 2^31 - 1</td></tr>
<tr><td><a href=\"modelica://EtherCAT.SDOReadReal\">SDOReadReal</a>,
<a href=\"modelica://EtherCAT.SDOWriteReal\">SDOWriteReal</a></td>
<td>all integers (exact up to 2^53), REAL32, REAL64</td></tr>
<tr><td><a href=\"modelica://EtherCAT.SDOReadString\">SDOReadString</a>,
<a href=\"modelica://EtherCAT.SDOWriteString\">SDOWriteString</a></td>
<td>VISIBLE_STRING, OCTET_STRING, UNICODE_STRING</td></tr>
</table>
</html>"));
