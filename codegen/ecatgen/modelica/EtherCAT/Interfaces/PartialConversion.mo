within EtherCAT.Interfaces;
partial block PartialConversion "Base of the blocks that convert the values of analog entries"
  extends Modelica.Blocks.Icons.Block;

  parameter EtherCAT.Types.AnalogRange range = EtherCAT.Conversions.Ranges.voltage10V
    "Raw values with their physical values"
    annotation (choices(
      choice = EtherCAT.Conversions.Ranges.voltage10V "-10 V to 10 V",
      choice = EtherCAT.Conversions.Ranges.voltageUnipolar10V "0 V to 10 V",
      choice = EtherCAT.Conversions.Ranges.current20mA "0 mA to 20 mA",
      choice = EtherCAT.Conversions.Ranges.current4To20mA "4 mA to 20 mA",
      choice = EtherCAT.Conversions.Ranges.temperature "temperature, 0.1 degC",
      choice = EtherCAT.Conversions.Ranges.perMille "1/1000 of a rated value"));

  Modelica.Blocks.Interfaces.BooleanOutput saturated
    "= true, if the value is at an end of the range, or beyond"
    annotation (Placement(transformation(extent = {{100, -90}, {120, -70}})));
protected
  parameter Real k = (range.max - range.min)/(range.rawMax - range.rawMin)
    "Physical value of one digit";
  annotation (
    Icon(graphics = {Text(extent = {{-30, -68}, {95, -92}}, textColor = {64, 64, 64}, textString = "saturated", horizontalAlignment = TextAlignment.Right)}),
    Documentation(info = "<html>
<p>
Has the range of the entry, and an output that is true when the value is at an end of the range or beyond it.
The ends of <code>range</code> must have different raw values.
</p>
</html>"));
end PartialConversion;
