within Modelica;
package Icons "Icons of classes other than blocks"
  partial class Information
    annotation (Icon(graphics = {
      Ellipse(extent = {{-98, 98}, {98, -98}}, lineColor = {70, 140, 75}, fillColor = {70, 140, 75}, fillPattern = FillPattern.Solid),
      Text(extent = {{-60, 80}, {60, -80}}, textColor = {255, 255, 255}, textString = "i", textStyle = {TextStyle.Bold, TextStyle.Italic})}));
  end Information;
  partial class Contact
    annotation (Icon(graphics = {
      Rectangle(extent = {{-98, 68}, {98, -68}}, fillColor = {236, 236, 236}, fillPattern = FillPattern.Solid),
      Line(points = {{-98, 68}, {0, -16}, {98, 68}})}));
  end Contact;
  partial class ReleaseNotes
    annotation (Icon(graphics = {
      Rectangle(extent = {{-76, 98}, {76, -98}}, fillColor = {244, 244, 244}, fillPattern = FillPattern.Solid),
      Line(points = {{-50, 50}, {50, 50}}), Line(points = {{-50, 10}, {50, 10}}), Line(points = {{-50, -30}, {20, -30}})}));
  end ReleaseNotes;
  partial model Example
    annotation (Icon(graphics = {
      Ellipse(extent = {{-98, 98}, {98, -98}}, lineColor = {70, 140, 75}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
      Polygon(points = {{-34, 58}, {62, 0}, {-34, -58}}, pattern = LinePattern.None, fillColor = {70, 140, 75}, fillPattern = FillPattern.Solid)}));
  end Example;
  partial package Package
    annotation (Icon(graphics = {
      Rectangle(extent = {{-98, 98}, {98, -98}}, radius = 24, lineColor = {190, 190, 190}, fillColor = {250, 250, 250}, fillPattern = FillPattern.HorizontalCylinder)}));
  end Package;
  partial package ExamplesPackage
    extends Icons.Package;
    annotation (Icon(graphics = {
      Polygon(points = {{-48, 58}, {52, 0}, {-48, -58}}, pattern = LinePattern.None, fillColor = {70, 140, 75}, fillPattern = FillPattern.Solid)}));
  end ExamplesPackage;
  partial package InterfacesPackage
    extends Icons.Package;
    annotation (Icon(graphics = {
      Polygon(points = {{20, 60}, {70, 60}, {70, -60}, {20, -60}, {-20, 0}}, lineColor = {100, 100, 100}, fillColor = {200, 200, 200}, fillPattern = FillPattern.Solid)}));
  end InterfacesPackage;
  partial package SourcesPackage
    extends Icons.Package;
    annotation (Icon(graphics = {
      Ellipse(extent = {{-66, 42}, {18, -42}}, lineColor = {100, 100, 100}), Line(points = {{18, 0}, {74, 0}}, arrow = {Arrow.None, Arrow.Filled})}));
  end SourcesPackage;
  partial package TypesPackage
    extends Icons.Package;
    annotation (Icon(graphics = {Text(extent = {{-70, 70}, {70, -70}}, textColor = {100, 100, 100}, textString = "T")}));
  end TypesPackage;
  partial package IconsPackage
    extends Icons.Package;
    annotation (Icon(graphics = {
      Ellipse(extent = {{-50, 50}, {50, -50}}, lineColor = {100, 100, 100}, fillColor = {170, 205, 170}, fillPattern = FillPattern.Solid)}));
  end IconsPackage;
  partial package FunctionsPackage
    extends Icons.Package;
    annotation (Icon(graphics = {Text(extent = {{-70, 70}, {70, -70}}, textColor = {100, 100, 100}, textString = "f", textStyle = {TextStyle.Italic})}));
  end FunctionsPackage;
  partial package InternalPackage
    extends Icons.Package;
  end InternalPackage;
  partial package UtilitiesPackage
    extends Icons.Package;
    annotation (Icon(graphics = {
      Polygon(points = {{-62, 46}, {-46, 62}, {10, 6}, {60, 10}, {10, -40}, {-6, -10}}, lineColor = {100, 100, 100}, fillColor = {180, 180, 180}, fillPattern = FillPattern.Solid)}));
  end UtilitiesPackage;
  partial record Record
    annotation (Icon(graphics = {
      Rectangle(extent = {{-98, 48}, {98, -98}}, lineColor = {64, 64, 64}, fillColor = {255, 215, 136}, fillPattern = FillPattern.Solid, radius = 20),
      Line(points = {{-98, 0}, {98, 0}}, color = {64, 64, 64}),
      Line(points = {{0, 48}, {0, -98}}, color = {64, 64, 64}),
      Text(extent = {{-150, 100}, {150, 60}}, textColor = {0, 0, 255}, textString = "%name")}));
  end Record;
  partial function Function
    annotation (Icon(graphics = {
      Ellipse(extent = {{-98, 98}, {98, -98}}, lineColor = {108, 88, 49}, fillColor = {255, 215, 136}, fillPattern = FillPattern.Solid),
      Text(extent = {{-90, 90}, {90, -90}}, textColor = {108, 88, 49}, textString = "f"),
      Text(extent = {{-150, 145}, {150, 105}}, textColor = {0, 0, 255}, textString = "%name")}));
  end Function;
end Icons;
