within ;
package Modelica "What our libraries use of the Modelica Standard Library 4.0.0, for checks and drawings"
  package Units
    package SI
      type Time = Real(final quantity = "Time", final unit = "s");
      type Period = Real(final quantity = "Time", final unit = "s");
    end SI;
  end Units;
  annotation (version = "4.0.0");
end Modelica;
