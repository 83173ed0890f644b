within EtherCAT;
package Icons "Icons"
  extends Modelica.Icons.IconsPackage;
end Icons;
