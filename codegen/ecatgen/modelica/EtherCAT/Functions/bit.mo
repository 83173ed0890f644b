within EtherCAT.Functions;
function bit "Whether a bit of a word is set"
  extends Modelica.Icons.Function;
  input Integer word "Word, not negative";
  input Integer number "Number of the bit, 0 is the lowest";
  output Boolean set "= true, if the bit is set";
algorithm
  set := mod(div(word, integer(2 ^ number)), 2) == 1;

  annotation (Documentation(info = "<html>
<p>
<code>set = mod(div(word, 2^number), 2) == 1</code>.
</p>
</html>"));
end bit;
