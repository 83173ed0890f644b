within EtherCAT.Functions;
function isSampled "Whether a domain takes part in a sample of the bus"
  extends Modelica.Icons.Function;
  input Real count "Number of the sample, 0 first";
  input Real ratio "Samples of the bus in a sample time of the domain";
  output Boolean sampled "True in every sample that the domain takes part in";
protected
  Real n "The ratio without the error of its computation";
algorithm
  n := floor(ratio + 0.5);
  sampled := count - n*floor(count/n) < 0.5;

  annotation (Documentation(info = "<html>
<p>
Counts instead of comparing times, which never are exact. The number of the sample is a Real, which counts without an error for
longer than any simulation lasts; an Integer would overflow after 24 days of 1&nbsp;kHz.
</p>
</html>"));
end isSampled;
