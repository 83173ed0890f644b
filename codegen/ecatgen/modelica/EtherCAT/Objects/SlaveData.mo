within EtherCAT.Objects;
record SlaveData "Place and identity of a slave"
  extends Modelica.Icons.Record;
  Integer position = 0 "Position on the bus, 0 first";
  String name = "" "Name of the slave in the configuration of ecatd, empty: by position";
  Integer vendorID = 0 "Vendor ID (32 unsigned bits, read as signed)";
  Integer productCode = 0 "Product code (32 unsigned bits, read as signed)";
  Integer revisionNumber = 0 "Revision number (32 unsigned bits, read as signed), 0: any";

  annotation (Documentation(info = "<html>
<p>
If <code>name</code> is given, the slave is found by the name that the configuration of ecatd gives it, wherever
it is on the bus, and <code>position</code> is ignored. The start of the simulation fails if no slave has this
name.
</p>
<p>
The paper on the DLR EtherCAT library uses the same name. Numbers of 32 bits without a sign are stored with a
sign: 0xFFFFFFFF is -1.
</p>
</html>"));
end SlaveData;
