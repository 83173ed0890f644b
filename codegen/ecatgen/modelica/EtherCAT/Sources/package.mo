within EtherCAT;
package Sources "Reference signals"
  extends Modelica.Icons.SourcesPackage;
end Sources;
