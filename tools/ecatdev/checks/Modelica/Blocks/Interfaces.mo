within Modelica.Blocks;
package Interfaces "Connectors of signals: a filled triangle is an input, an empty one an output"
  connector RealInput = input Real annotation (
    Icon(graphics = {Polygon(points = {{-100, 100}, {100, 0}, {-100, -100}}, lineColor = {0, 0, 127}, fillColor = {0, 0, 127}, fillPattern = FillPattern.Solid)}),
    Diagram(graphics = {
      Polygon(points = {{0, 50}, {100, 0}, {0, -50}}, lineColor = {0, 0, 127}, fillColor = {0, 0, 127}, fillPattern = FillPattern.Solid),
      Text(extent = {{-10, 60}, {-10, 90}}, textColor = {0, 0, 127}, textString = "%name")}));
  connector RealOutput = output Real annotation (
    Icon(graphics = {Polygon(points = {{-100, 100}, {100, 0}, {-100, -100}}, lineColor = {0, 0, 127}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid)}),
    Diagram(graphics = {
      Polygon(points = {{-100, 50}, {0, 0}, {-100, -50}}, lineColor = {0, 0, 127}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
      Text(extent = {{10, 60}, {10, 90}}, textColor = {0, 0, 127}, textString = "%name")}));
  connector IntegerInput = input Integer annotation (
    Icon(graphics = {Polygon(points = {{-100, 100}, {100, 0}, {-100, -100}}, lineColor = {255, 127, 0}, fillColor = {255, 127, 0}, fillPattern = FillPattern.Solid)}),
    Diagram(graphics = {
      Polygon(points = {{0, 50}, {100, 0}, {0, -50}}, lineColor = {255, 127, 0}, fillColor = {255, 127, 0}, fillPattern = FillPattern.Solid),
      Text(extent = {{-10, 60}, {-10, 90}}, textColor = {255, 127, 0}, textString = "%name")}));
  connector IntegerOutput = output Integer annotation (
    Icon(graphics = {Polygon(points = {{-100, 100}, {100, 0}, {-100, -100}}, lineColor = {255, 127, 0}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid)}),
    Diagram(graphics = {
      Polygon(points = {{-100, 50}, {0, 0}, {-100, -50}}, lineColor = {255, 127, 0}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
      Text(extent = {{10, 60}, {10, 90}}, textColor = {255, 127, 0}, textString = "%name")}));
  connector BooleanInput = input Boolean annotation (
    Icon(graphics = {Polygon(points = {{-100, 100}, {100, 0}, {-100, -100}}, lineColor = {255, 0, 255}, fillColor = {255, 0, 255}, fillPattern = FillPattern.Solid)}),
    Diagram(graphics = {
      Polygon(points = {{0, 50}, {100, 0}, {0, -50}}, lineColor = {255, 0, 255}, fillColor = {255, 0, 255}, fillPattern = FillPattern.Solid),
      Text(extent = {{-10, 60}, {-10, 90}}, textColor = {255, 0, 255}, textString = "%name")}));
  connector BooleanOutput = output Boolean annotation (
    Icon(graphics = {Polygon(points = {{-100, 100}, {100, 0}, {-100, -100}}, lineColor = {255, 0, 255}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid)}),
    Diagram(graphics = {
      Polygon(points = {{-100, 50}, {0, 0}, {-100, -50}}, lineColor = {255, 0, 255}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
      Text(extent = {{10, 60}, {10, 90}}, textColor = {255, 0, 255}, textString = "%name")}));

  partial block SignalSource
    extends Icons.Block;
    RealOutput y annotation (Placement(transformation(extent = {{100, -10}, {120, 10}})));
  end SignalSource;
  partial block IntegerSignalSource
    extends Icons.IntegerBlock;
    IntegerOutput y annotation (Placement(transformation(extent = {{100, -10}, {120, 10}})));
  end IntegerSignalSource;
  partial block BooleanSignalSource
    extends Icons.PartialBooleanBlock;
    BooleanOutput y annotation (Placement(transformation(extent = {{100, -10}, {120, 10}})));
  end BooleanSignalSource;
end Interfaces;
