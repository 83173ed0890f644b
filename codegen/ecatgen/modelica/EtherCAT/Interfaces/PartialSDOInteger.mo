within EtherCAT.Interfaces;
partial block PartialSDOInteger "Base of the blocks that have an object as Integer"
  extends EtherCAT.Interfaces.PartialSDO(
    final typeNumber = Integer(dataType),
    final valueType = 1,
    final scale = 1,
    final offset = 0);

  parameter EtherCAT.Types.DataType dataType = EtherCAT.Types.DataType.UNSIGNED16
    "Data type of the object" annotation (Dialog(group = "Object"), choices(
      choice = EtherCAT.Types.DataType.BOOLEAN "BOOLEAN",
      choice = EtherCAT.Types.DataType.INTEGER8 "INTEGER8",
      choice = EtherCAT.Types.DataType.UNSIGNED8 "UNSIGNED8",
      choice = EtherCAT.Types.DataType.INTEGER16 "INTEGER16",
      choice = EtherCAT.Types.DataType.UNSIGNED16 "UNSIGNED16",
      choice = EtherCAT.Types.DataType.INTEGER24 "INTEGER24",
      choice = EtherCAT.Types.DataType.UNSIGNED24 "UNSIGNED24",
      choice = EtherCAT.Types.DataType.INTEGER32 "INTEGER32",
      choice = EtherCAT.Types.DataType.UNSIGNED32 "UNSIGNED32",
      choice = EtherCAT.Types.DataType.INTEGER40 "INTEGER40",
      choice = EtherCAT.Types.DataType.UNSIGNED40 "UNSIGNED40",
      choice = EtherCAT.Types.DataType.INTEGER48 "INTEGER48",
      choice = EtherCAT.Types.DataType.UNSIGNED48 "UNSIGNED48",
      choice = EtherCAT.Types.DataType.INTEGER56 "INTEGER56",
      choice = EtherCAT.Types.DataType.UNSIGNED56 "UNSIGNED56",
      choice = EtherCAT.Types.DataType.INTEGER64 "INTEGER64",
      choice = EtherCAT.Types.DataType.UNSIGNED64 "UNSIGNED64"));

  annotation (Documentation(info = "<html>
<p>
The object is an integer; its value must lie between -2^31 and 2^31 - 1.
</p>
</html>"));
end PartialSDOInteger;
