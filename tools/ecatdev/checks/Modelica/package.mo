within ;
package Modelica "The part of the Modelica Standard Library 4.0.0 that our libraries use, for checks and drawings"
  package Units
    package SI
      type Time = Real(final quantity = "Time", final unit = "s");
      type Angle = Real(final quantity = "Angle", final unit = "rad", displayUnit = "deg");
      type AngularVelocity = Real(final quantity = "AngularVelocity", final unit = "rad/s");
      type Torque = Real(final quantity = "Torque", final unit = "N.m");
      type Current = Real(final quantity = "ElectricCurrent", final unit = "A");
      type Voltage = Real(final quantity = "ElectricPotential", final unit = "V");
      type Period = Real(final quantity = "Time", final unit = "s");
    end SI;
  end Units;
  package Constants
    constant Real pi = 3.141592653589793;
  end Constants;
  package Utilities
    package Files
      function loadResource
        input String uri;
        output String fileReference;
      algorithm
        fileReference := uri;
      end loadResource;
    end Files;
  end Utilities;
  annotation (version = "4.0.0");
end Modelica;
