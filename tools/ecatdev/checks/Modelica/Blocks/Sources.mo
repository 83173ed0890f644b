within Modelica.Blocks;
package Sources "Sources of signals"
  block Constant
    extends Interfaces.SignalSource;
    parameter Real k(start = 1);
  equation
    y = k;
    annotation (Icon(graphics = {
        Line(points = {{-80, 84}, {-80, -82}}, color = {180, 180, 180}),
        Line(points = {{-88, -68}, {84, -68}}, color = {180, 180, 180}),
        Line(points = {{-80, 0}, {76, 0}}),
        Text(extent = {{-150, -150}, {150, -110}}, textString = "k=%k")}));
  end Constant;
  block IntegerConstant
    extends Interfaces.IntegerSignalSource;
    parameter Integer k(start = 1);
  equation
    y = k;
    annotation (Icon(graphics = {
        Line(points = {{-80, 84}, {-80, -82}}, color = {180, 180, 180}),
        Line(points = {{-88, -68}, {84, -68}}, color = {180, 180, 180}),
        Line(points = {{-80, 0}, {76, 0}}),
        Text(extent = {{-150, -150}, {150, -110}}, textString = "k=%k")}));
  end IntegerConstant;
  block BooleanConstant
    extends Interfaces.BooleanSignalSource;
    parameter Boolean k = true;
  equation
    y = k;
    annotation (Icon(graphics = {
        Line(points = {{-80, 84}, {-80, -82}}, color = {180, 180, 180}),
        Line(points = {{-88, -68}, {84, -68}}, color = {180, 180, 180}),
        Line(points = {{-80, 0}, {76, 0}}),
        Text(extent = {{-150, -150}, {150, -110}}, textString = "%k")}));
  end BooleanConstant;
  block Step
    extends Interfaces.SignalSource;
    parameter Real height = 1;
    parameter Real offset = 0;
    parameter Units.SI.Time startTime = 0;
  equation
    y = offset + (if time < startTime then 0 else height);
    annotation (Icon(graphics = {
        Line(points = {{-80, 84}, {-80, -82}}, color = {180, 180, 180}),
        Line(points = {{-88, -68}, {84, -68}}, color = {180, 180, 180}),
        Line(points = {{-80, -68}, {0, -68}, {0, 46}, {76, 46}}, color = {0, 0, 127}),
        Text(extent = {{-150, -150}, {150, -110}}, textString = "startTime=%startTime")}));
  end Step;
  block Sine
    extends Interfaces.SignalSource;
    parameter Real amplitude = 1;
    parameter Real f(start = 1);
    parameter Real offset = 0;
  equation
    y = offset + amplitude * sin(6.283185307179586 * f * time);
    annotation (Icon(graphics = {
        Line(points = {{-80, 84}, {-80, -82}}, color = {180, 180, 180}),
        Line(points = {{-88, 0}, {84, 0}}, color = {180, 180, 180}),
        Line(points = {{-80, 0}, {-58, 56}, {-40, 74}, {-22, 56}, {0, 0}, {22, -56}, {40, -74}, {58, -56}, {80, 0}}, color = {0, 0, 127}, smooth = Smooth.Bezier),
        Text(extent = {{-150, -150}, {150, -110}}, textString = "f=%f")}));
  end Sine;
  block BooleanExpression
    Interfaces.BooleanOutput y = false
      annotation (Placement(transformation(extent = {{100, -10}, {120, 10}})));
    annotation (Icon(graphics = {
        Rectangle(extent = {{-100, 40}, {100, -40}}, fillColor = {235, 235, 235}, fillPattern = FillPattern.Solid),
        Text(extent = {{-96, 15}, {96, -15}}, textString = "%y"),
        Text(extent = {{-150, 90}, {150, 50}}, textString = "%name")}));
  end BooleanExpression;
  block BooleanPulse
    extends Interfaces.BooleanSignalSource;
    parameter Real width = 50;
    parameter Units.SI.Time period(start = 1);
    parameter Units.SI.Time startTime = 0;
  equation
    y = mod(time - startTime, period) < period * width / 100;
    annotation (Icon(graphics = {
        Line(points = {{-80, 84}, {-80, -82}}, color = {180, 180, 180}),
        Line(points = {{-88, -68}, {84, -68}}, color = {180, 180, 180}),
        Line(points = {{-80, -68}, {-44, -68}, {-44, 46}, {-4, 46}, {-4, -68}, {36, -68}, {36, 46}, {72, 46}}),
        Text(extent = {{-150, -150}, {150, -110}}, textString = "%period")}));
  end BooleanPulse;
  block CombiTimeTable
    extends Icons.Block;
    parameter Boolean tableOnFile = false;
    parameter String tableName = "NoName";
    parameter String fileName = "NoName";
    parameter Boolean verboseRead = true;
    parameter Integer columns[:] = {2};
    parameter Types.Smoothness smoothness = Types.Smoothness.LinearSegments;
    parameter Types.Extrapolation extrapolation = Types.Extrapolation.LastTwoPoints;
    parameter Units.SI.Time startTime = 0;
    Interfaces.RealOutput y[size(columns, 1)] annotation (Placement(transformation(extent = {{100, -10}, {120, 10}})));
  equation
    for n in 1:size(columns, 1) loop
      y[n] = time - startTime + columns[n];
    end for;
  end CombiTimeTable;
end Sources;
