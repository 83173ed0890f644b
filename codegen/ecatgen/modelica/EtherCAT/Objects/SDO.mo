within EtherCAT.Objects;
class SDO "One object of a slave, accessed through its mailbox"
  extends ExternalObject;

  function constructor "Register the access to an object"
    input EtherCAT.Objects.Master master "Connection";
    input Integer position "Position of the slave on the bus, 0 first";
    input String slaveName "Name of the slave in the configuration of ecatd, empty: by position";
    input Integer index "Index of the object";
    input Integer subindex "Subindex of the object";
    input Integer dataType "CoE data type: number of the EtherCAT.Types.DataType";
    input Integer valueType = 1 "Type of the value in the model, 1: Integer, 2: Real, 3: String";
    input Integer request = 1 "When it is requested: number of the EtherCAT.Types.Request";
    input Real period = 0 "Time between two sampled requests in s";
    input Real scale = 1 "Real value = value of the object * scale + offset";
    input Real offset = 0 "See scale";
    input String object = "" "Index and subindex as \"0x6060:00\", instead of the numbers";
    input String instance = "" "Name of the instance of the block, for messages";
    output SDO sdo "Object";
    external "C" sdo = ecatm_sdo_open(master, position, slaveName, index, subindex, dataType, valueType, request, period, scale, offset, object, instance)
      annotation (
        Include = "#include \"ecat_modelica.h\"",
        IncludeDirectory = "modelica://EtherCAT/Resources/Include",
        Library = "ecat",
        LibraryDirectory = "modelica://EtherCAT/Resources/Library");
  end constructor;

  function destructor "Release it"
    input SDO sdo "Object";
    external "C" ecatm_sdo_close(sdo)
      annotation (
        Include = "#include \"ecat_modelica.h\"",
        IncludeDirectory = "modelica://EtherCAT/Resources/Include",
        Library = "ecat",
        LibraryDirectory = "modelica://EtherCAT/Resources/Library");
  end destructor;

  annotation (Documentation(info = "<html>
<p>
The SDO blocks use it to access one object. It may have one request at a time.
</p>
</html>"));
end SDO;
