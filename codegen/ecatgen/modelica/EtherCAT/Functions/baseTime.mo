within EtherCAT.Functions;
function baseTime "The longest time that all sample times are multiples of"
  extends Modelica.Icons.Function;
  input Real sampleTime[:] "Sample time of each domain, in s";
  output Real base "Common base, in s";
protected
  Real candidate "Time that may be the base, in s";
  Boolean fits "True, if all sample times are multiples of the candidate";
algorithm
  assert(size(sampleTime, 1) > 0, "EtherCAT: the EtherCATMaster needs a sample time; change sampleTime");
  assert(min(sampleTime) > 0, "EtherCAT: all sample times of the EtherCATMaster must be positive; change sampleTime");
  base := 0;
  for i in 1:10 loop
    candidate := min(sampleTime)/(11 - i);
    fits := true;
    for d in 1:size(sampleTime, 1) loop
      fits := fits and abs(sampleTime[d]/candidate - floor(sampleTime[d]/candidate + 0.5)) <= 1e-9;
    end for;
    base := if fits then candidate else base;
  end for;
  assert(base > 0, "EtherCAT: the sample times of the EtherCATMaster are no multiples of one time of at least a tenth of the shortest, which is " + String(min(sampleTime)) + " s; change sampleTime, for example to multiples of the shortest");

  annotation (Documentation(info = "<html>
<p>
The <a href=\"modelica://EtherCAT.EtherCATMaster\">EtherCATMaster</a> samples the bus with this period, and counts for
each domain. The base is the shortest sample time divided by 1 to 10. A multiple is a whole number to 1e-9. If there is
no such base, the translation of the model fails with a clear message.
</p>
</html>"));
end baseTime;
