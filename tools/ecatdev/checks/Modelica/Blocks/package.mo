within Modelica;
package Blocks
  package Icons
    partial block Block
      annotation (Icon(graphics = {
        Rectangle(extent = {{-100, 100}, {100, -100}}, lineColor = {0, 0, 127}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
        Text(extent = {{-150, 150}, {150, 110}}, textColor = {0, 0, 255}, textString = "%name")}));
    end Block;
    partial block IntegerBlock
      annotation (Icon(graphics = {
        Rectangle(extent = {{-100, 100}, {100, -100}}, lineColor = {255, 127, 0}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
        Text(extent = {{-150, 150}, {150, 110}}, textColor = {0, 0, 255}, textString = "%name")}));
    end IntegerBlock;
    partial block BooleanBlock
      annotation (Icon(graphics = {
        Rectangle(extent = {{-100, 100}, {100, -100}}, lineColor = {255, 0, 255}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
        Text(extent = {{-150, 150}, {150, 110}}, textColor = {0, 0, 255}, textString = "%name")}));
    end BooleanBlock;
    partial block PartialBooleanBlock
      annotation (Icon(graphics = {
        Rectangle(extent = {{-100, 100}, {100, -100}}, fillColor = {212, 212, 212}, fillPattern = FillPattern.Solid),
        Text(extent = {{-150, 150}, {150, 110}}, textColor = {0, 0, 255}, textString = "%name")}));
    end PartialBooleanBlock;
  end Icons;

  package Types
    type Smoothness = enumeration(LinearSegments, ContinuousDerivative, ConstantSegments, MonotoneContinuousDerivative1, MonotoneContinuousDerivative2, ModifiedContinuousDerivative);
    type Extrapolation = enumeration(HoldLastPoint, LastTwoPoints, Periodic, NoExtrapolation);
    type Init = enumeration(NoInit, SteadyState, InitialState, InitialOutput);
  end Types;

  package Math
    block Gain
      parameter Real k(start = 1);
      Interfaces.RealInput u annotation (Placement(transformation(extent = {{-140, -20}, {-100, 20}})));
      Interfaces.RealOutput y annotation (Placement(transformation(extent = {{100, -10}, {120, 10}})));
    equation
      y = k * u;
      annotation (Icon(graphics = {
        Polygon(points = {{-100, -100}, {-100, 100}, {100, 0}}, lineColor = {0, 0, 127}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
        Text(extent = {{-150, -140}, {150, -100}}, textString = "k=%k"),
        Text(extent = {{-150, 140}, {150, 100}}, textColor = {0, 0, 255}, textString = "%name")}));
    end Gain;
  end Math;

  package Continuous
    block FirstOrder
      extends Icons.Block;
      parameter Real k = 1;
      parameter Units.SI.Time T(start = 1);
      parameter Types.Init initType = Types.Init.NoInit;
      parameter Real y_start = 0;
      Interfaces.RealInput u annotation (Placement(transformation(extent = {{-140, -20}, {-100, 20}})));
      Interfaces.RealOutput y annotation (Placement(transformation(extent = {{100, -10}, {120, 10}})));
    equation
      der(y) = (k * u - y) / T;
      annotation (Icon(graphics = {
        Line(points = {{-80, 84}, {-80, -82}}, color = {180, 180, 180}),
        Line(points = {{-88, -68}, {84, -68}}, color = {180, 180, 180}),
        Line(points = {{-80, -68}, {-62, 0}, {-28, 50}, {10, 58}, {76, 60}}, color = {0, 0, 127}, smooth = Smooth.Bezier),
        Text(extent = {{-20, 10}, {80, -50}}, textColor = {180, 180, 180}, textString = "PT1"),
        Text(extent = {{-150, -150}, {150, -110}}, textString = "T=%T")}));
    end FirstOrder;
    block Integrator
      extends Icons.Block;
      parameter Real k = 1;
      parameter Types.Init initType = Types.Init.InitialState;
      parameter Real y_start = 0;
      Interfaces.RealInput u annotation (Placement(transformation(extent = {{-140, -20}, {-100, 20}})));
      Interfaces.RealOutput y(start = y_start) annotation (Placement(transformation(extent = {{100, -10}, {120, 10}})));
    equation
      der(y) = k * u;
      annotation (Icon(graphics = {
        Line(points = {{-80, 84}, {-80, -82}}, color = {180, 180, 180}),
        Line(points = {{-88, -76}, {84, -76}}, color = {180, 180, 180}),
        Text(extent = {{0, -8}, {60, -62}}, textColor = {180, 180, 180}, textString = "I"),
        Line(points = {{-80, -76}, {76, 76}}, color = {0, 0, 127}),
        Text(extent = {{-150, -150}, {150, -110}}, textString = "k=%k")}));
    end Integrator;
  end Continuous;

  package Logical
    block Switch
      extends Icons.PartialBooleanBlock;
      Interfaces.RealInput u1 annotation (Placement(transformation(extent = {{-140, 60}, {-100, 100}})));
      Interfaces.BooleanInput u2 annotation (Placement(transformation(extent = {{-140, -20}, {-100, 20}})));
      Interfaces.RealInput u3 annotation (Placement(transformation(extent = {{-140, -100}, {-100, -60}})));
      Interfaces.RealOutput y annotation (Placement(transformation(extent = {{100, -10}, {120, 10}})));
    equation
      y = if u2 then u1 else u3;
      annotation (Icon(graphics = {
        Line(points = {{-100, 80}, {-36, 80}, {8, 6}}, color = {0, 0, 127}, thickness = 0.75),
        Line(points = {{-100, 0}, {-38, 0}}, color = {255, 0, 255}),
        Line(points = {{-100, -80}, {-36, -80}}, color = {0, 0, 127}),
        Line(points = {{12, 0}, {100, 0}}, color = {0, 0, 127}),
        Ellipse(extent = {{2, 10}, {22, -10}}, lineColor = {0, 0, 127}, fillColor = {0, 0, 127}, fillPattern = FillPattern.Solid)}));
    end Switch;
  end Logical;
end Blocks;
