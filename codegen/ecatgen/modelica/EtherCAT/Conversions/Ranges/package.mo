within EtherCAT.Conversions;
package Ranges "Ranges of analog terminals"
  extends Modelica.Icons.Package;

  constant EtherCAT.Types.AnalogRange voltage10V(
    rawMin = -32767, rawMax = 32767, min = -10, max = 10)
    "-10 V to 10 V (EL3004, EL3008, EL3102, EL4034, EL4038)";
  constant EtherCAT.Types.AnalogRange voltageUnipolar10V(
    rawMin = 0, rawMax = 32767, min = 0, max = 10)
    "0 V to 10 V (EL3064, EL3068, EL4004, EL4008)";
  constant EtherCAT.Types.AnalogRange current20mA(
    rawMin = 0, rawMax = 32767, min = 0, max = 0.02)
    "0 mA to 20 mA (EL3044, EL3048, EL4014, EL4018), in A";
  constant EtherCAT.Types.AnalogRange current4To20mA(
    rawMin = 0, rawMax = 32767, min = 0.004, max = 0.02)
    "4 mA to 20 mA (EL3054, EL3058, EL4024, EL4028), in A";
  constant EtherCAT.Types.AnalogRange temperature(
    rawMin = -2731, rawMax = 32767, min = 0.05, max = 3549.85)
    "0.1 degC a digit (EL32xx with PT100, EL33xx with thermocouples), in K";
  constant EtherCAT.Types.AnalogRange perMille(
    rawMin = -32767, rawMax = 32767, min = -32.767, max = 32.767)
    "1/1000 of a rated value a digit (torque and current of CiA 402 drives)";

  annotation (
    Icon(graphics = {
      Line(points = {{-60, -20}, {60, -20}}, color = {64, 64, 64}, thickness = 0.5),
      Line(points = {{-60, -40}, {-60, 0}}, color = {64, 64, 64}, thickness = 0.5),
      Line(points = {{60, -40}, {60, 0}}, color = {64, 64, 64}, thickness = 0.5),
      Line(points = {{-30, -30}, {-30, -10}}, color = {64, 64, 64}),
      Line(points = {{0, -30}, {0, -10}}, color = {64, 64, 64}),
      Line(points = {{30, -30}, {30, -10}}, color = {64, 64, 64}),
      Polygon(points = {{18, -10}, {6, 18}, {30, 18}}, lineColor = {64, 64, 64}, fillColor = {95, 158, 160}, fillPattern = FillPattern.Solid)}),
    Documentation(info = "<html>
<p>
Constants for the parameter <code>range</code> of
<a href=\"modelica://EtherCAT.Conversions.RawToReal\">RawToReal</a> and
<a href=\"modelica://EtherCAT.Conversions.RealToRaw\">RealToRaw</a>. They hold for the scaling that the
terminals are delivered with (16 bits with a sign, 0x7FFF at the end of the range); a terminal
whose user scale was changed by SDO needs a range of its own, for example
<code>EtherCAT.Types.AnalogRange(rawMin = 0, rawMax = 10000, min = 0, max = 10)</code>.
</p>
</html>"));
end Ranges;
