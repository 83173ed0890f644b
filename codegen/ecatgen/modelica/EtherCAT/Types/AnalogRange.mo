within EtherCAT.Types;
record AnalogRange "Raw values of an entry with their physical values"
  extends Modelica.Icons.Record;
  Integer rawMin = -32767 "Raw value that stands for min";
  Integer rawMax = 32767 "Raw value that stands for max";
  Real min = -1 "Physical value of rawMin, in SI units";
  Real max = 1 "Physical value of rawMax, in SI units";
  annotation (Documentation(info = "<html>
<p>
A line through two points: raw value <code>rawMin</code> is the physical value <code>min</code>,
<code>rawMax</code> is <code>max</code>. The usual ranges of terminals are constants in
<a href=\"modelica://EtherCAT.Conversions.Ranges\">Conversions.Ranges</a>.
</p>
</html>"));
end AnalogRange;
