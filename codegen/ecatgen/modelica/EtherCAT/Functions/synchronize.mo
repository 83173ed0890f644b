within EtherCAT.Functions;
impure function synchronize "Wait until the clock of the machine has reached the simulation time"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.RealtimeClock realtimeClock "Clock";
  input Real t "Simulation time";
  input Real scaling "Seconds of the clock for one of simulation time, 0: do not wait";
  input Real maxDelay "Largest delay that later steps make up for, in s";
  output Real results[4]
    "Time since the end of the step before, its upper limit, lateness (all in s), missed steps";
  external "C" ecatm_realtime_step(realtimeClock, t, scaling, maxDelay, results)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");

  annotation (Documentation(info = "<html>
<p>
The <a href=\"modelica://EtherCAT.SynchronizeRealtime\">SynchronizeRealtime</a> block explains the rule. A
second call at the same time has the same results and does not wait.
</p>
</html>"));
end synchronize;
