within EtherCAT.Objects;
record SlaveData "Place and identity of a slave"
  extends Modelica.Icons.Record;
  Integer position = 0 "Position on the bus, 0 first";
  String name = "" "Name that the configuration of ecatd must give the slave, empty: any";
  Integer vendorID = 0 "Vendor ID (32 unsigned bits, read as signed)";
  Integer productCode = 0 "Product code (32 unsigned bits, read as signed)";
  Integer revisionNumber = 0 "Revision number (32 unsigned bits, read as signed), 0: any";

  annotation (Documentation(info = "<html>
<p>
<code>name</code> tells slaves of the same kind from each other, which may have changed places: the start of the
simulation fails with one sentence when the slave at <code>position</code> has another name.
</p>
<p>
The paper on the DLR EtherCAT library calls it so, too. Numbers with 32 bits without a sign are held with
one: 0xFFFFFFFF is -1.
</p>
</html>"));
end SlaveData;
