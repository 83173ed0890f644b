within EtherCAT.Interfaces;
partial block PartialSDOString "Base of the blocks that have an object as String"
  extends EtherCAT.Interfaces.PartialSDO(
    final typeNumber = Integer(dataType),
    final valueType = 3,
    final scale = 1,
    final offset = 0);

  parameter EtherCAT.Types.DataType dataType = EtherCAT.Types.DataType.VISIBLE_STRING
    "Data type of the object" annotation (Dialog(group = "Object"), choices(
      choice = EtherCAT.Types.DataType.VISIBLE_STRING "VISIBLE_STRING",
      choice = EtherCAT.Types.DataType.OCTET_STRING "OCTET_STRING",
      choice = EtherCAT.Types.DataType.UNICODE_STRING "UNICODE_STRING"));

  annotation (Documentation(info = "<html>
<p>
The object is a text of up to 512 bytes.
</p>
</html>"));
end PartialSDOString;
