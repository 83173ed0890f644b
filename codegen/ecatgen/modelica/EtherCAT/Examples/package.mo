within EtherCAT;
package Examples "Models that run on any bus"
  extends Modelica.Icons.ExamplesPackage;
end Examples;
