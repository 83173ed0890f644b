within EtherCAT.Interfaces;
partial block PartialSDO "Base of the blocks that access one object of a slave"
  extends EtherCAT.Icons.SDO;

  parameter Integer position(min = 0) = 0 "Position of the slave on the bus, 0 first";
  parameter Integer index(min = 0, max = 65535) "Index of the object"
    annotation (Dialog(group = "Object"));
  parameter Integer subindex(min = 0, max = 255) = 0 "Subindex of the object"
    annotation (Dialog(group = "Object"));
  parameter EtherCAT.Types.DataType dataType = EtherCAT.Types.DataType.UNSIGNED16
    "Data type of the object" annotation (Dialog(group = "Object"));

  Modelica.Blocks.Interfaces.BooleanInput trigger
    "A rising edge, or true from the start, sends the request"
    annotation (Placement(transformation(extent = {{-140, 40}, {-100, 80}})));
  Modelica.Blocks.Interfaces.BooleanOutput done(start = false, fixed = true)
    "= true, if the last request succeeded"
    annotation (Placement(transformation(extent = {{100, 20}, {120, 40}})));
  Modelica.Blocks.Interfaces.BooleanOutput busy(start = false, fixed = true)
    "= true, while a request is running"
    annotation (Placement(transformation(extent = {{100, -40}, {120, -20}})));
  Modelica.Blocks.Interfaces.IntegerOutput abortCode(start = 0, fixed = true)
    "SDO abort code if the last request failed, negative if the slave did not answer, else 0"
    annotation (Placement(transformation(extent = {{100, -90}, {120, -70}})));
protected
  outer EtherCAT.EtherCATMaster etherCATMaster;
  parameter EtherCAT.Objects.SDO sdo = EtherCAT.Objects.SDO(
    etherCATMaster.master, position, index, subindex, Integer(dataType));
  Integer state(start = 0, fixed = true) "0: no request yet, 1: busy, 2: done, 3: failed";
equation
  when etherCATMaster.sampled[1] then
    busy = state == 1;
    done = state == 2;
    abortCode = EtherCAT.Functions.sdoAbortCode(sdo, state);
  end when;
  annotation (Documentation(info = "<html>
<p>
The trigger is looked at in every sample of domain 1. While a request is running, further triggers are
ignored. No request delays the simulation.
</p>
</html>"));
end PartialSDO;
