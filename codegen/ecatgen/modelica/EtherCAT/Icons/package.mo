within EtherCAT;
package Icons "Icons"
  extends Modelica.Icons.IconsPackage;

  annotation (Documentation(info = "<html>
<p>
Icons that blocks extend.
</p>
</html>"));
end Icons;
