within EtherCAT.Interfaces;
partial block PartialSDOReal "Base of the blocks that have an object as Real"
  extends EtherCAT.Interfaces.PartialSDO(
    final typeNumber = Integer(dataType),
    final valueType = 2);

  parameter EtherCAT.Types.DataType dataType = EtherCAT.Types.DataType.REAL32
    "Data type of the object" annotation (Dialog(group = "Object"), choices(
      choice = EtherCAT.Types.DataType.REAL32 "REAL32",
      choice = EtherCAT.Types.DataType.REAL64 "REAL64",
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
  parameter String unit = "" "Unit of the value of the block"
    annotation (Evaluate = true, Dialog(group = "Scaling"));

  annotation (Documentation(info = "<html>
<p>
The object is a number; integers are exact up to 2^53. The value of the block is the value of the object times
<code>scale</code> plus <code>offset</code>, in <code>unit</code>.
</p>
</html>"));
end PartialSDOReal;
