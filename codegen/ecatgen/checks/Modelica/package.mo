within ;
package Modelica "Interfaces of the Modelica Standard Library 4.0.0 that our libraries use, for checks"
  package Icons
    partial class Information
    end Information;
    partial class Contact
    end Contact;
    partial class ReleaseNotes
    end ReleaseNotes;
    partial model Example
    end Example;
    partial package Package
    end Package;
    partial package ExamplesPackage
    end ExamplesPackage;
    partial package InterfacesPackage
    end InterfacesPackage;
    partial package SourcesPackage
    end SourcesPackage;
    partial package TypesPackage
    end TypesPackage;
    partial package IconsPackage
    end IconsPackage;
    partial package FunctionsPackage
    end FunctionsPackage;
    partial package InternalPackage
    end InternalPackage;
  end Icons;

  package Units
    package SI
      type Time = Real(final quantity = "Time", final unit = "s");
      type Period = Real(final quantity = "Time", final unit = "s");
    end SI;
  end Units;

  package Blocks
    package Icons
      partial block Block
      end Block;
      partial block IntegerBlock
      end IntegerBlock;
    end Icons;

    package Interfaces
      connector RealInput = input Real;
      connector RealOutput = output Real;
      connector IntegerInput = input Integer;
      connector IntegerOutput = output Integer;
      connector BooleanInput = input Boolean;
      connector BooleanOutput = output Boolean;
    end Interfaces;

    package Sources
      block Constant
        parameter Real k(start = 1);
        Interfaces.RealOutput y;
      equation
        y = k;
      end Constant;
      block IntegerConstant
        parameter Integer k(start = 1);
        Interfaces.IntegerOutput y;
      equation
        y = k;
      end IntegerConstant;
      block BooleanConstant
        parameter Boolean k = true;
        Interfaces.BooleanOutput y;
      equation
        y = k;
      end BooleanConstant;
      block Step
        parameter Real height = 1;
        parameter Real offset = 0;
        parameter Units.SI.Time startTime = 0;
        Interfaces.RealOutput y;
      equation
        y = offset + (if time < startTime then 0 else height);
      end Step;
      block Sine
        parameter Real amplitude = 1;
        parameter Real f(start = 1);
        parameter Real offset = 0;
        Interfaces.RealOutput y;
      equation
        y = offset + amplitude * sin(6.283185307179586 * f * time);
      end Sine;
      block BooleanPulse
        parameter Real width = 50;
        parameter Units.SI.Time period(start = 1);
        parameter Units.SI.Time startTime = 0;
        Interfaces.BooleanOutput y;
      equation
        y = mod(time - startTime, period) < period * width / 100;
      end BooleanPulse;
    end Sources;

    package Types
      type Init = enumeration(NoInit, SteadyState, InitialState, InitialOutput);
    end Types;

    package Continuous
      block FirstOrder
        parameter Real k = 1;
        parameter Units.SI.Time T(start = 1);
        parameter Types.Init initType = Types.Init.NoInit;
        parameter Real y_start = 0;
        Interfaces.RealInput u;
        Interfaces.RealOutput y;
      equation
        der(y) = (k * u - y) / T;
      end FirstOrder;
    end Continuous;

    package Logical
      block Switch
        Interfaces.RealInput u1;
        Interfaces.BooleanInput u2;
        Interfaces.RealInput u3;
        Interfaces.RealOutput y;
      equation
        y = if u2 then u1 else u3;
      end Switch;
    end Logical;
  end Blocks;
  annotation (version = "4.0.0");
end Modelica;
