within EtherCAT.Objects;
record SlaveData "Place and identity of a slave"
  extends Modelica.Icons.Record;
  Integer position = 0 "Position on the bus, 0 first";
  Integer vendorID = 0 "Vendor ID (32 unsigned bits, read as signed)";
  Integer productCode = 0 "Product code (32 unsigned bits, read as signed)";
  Integer revisionNumber = 0 "Revision number (32 unsigned bits, read as signed), 0: any";
end SlaveData;
