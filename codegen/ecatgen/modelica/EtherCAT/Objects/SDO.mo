within EtherCAT.Objects;
class SDO "One object of a slave, accessed through its mailbox"
  extends ExternalObject;

  function constructor "Register the access to an object"
    input EtherCAT.Objects.Master master "Connection";
    input Integer position "Position of the slave on the bus, 0 first";
    input Integer index "Index of the object";
    input Integer subindex "Subindex of the object";
    input Integer dataType "Number of the EtherCAT.Types.DataType";
    output SDO sdo;
    external "C" sdo = ecatm_sdo_open(master, position, index, subindex, dataType)
      annotation (
        Include = "#include \"ecat_modelica.h\"",
        IncludeDirectory = "modelica://EtherCAT/Resources/Include",
        Library = "ecat",
        LibraryDirectory = "modelica://EtherCAT/Resources/Library");
  end constructor;

  function destructor "Release it"
    input SDO sdo;
    external "C" ecatm_sdo_close(sdo)
      annotation (
        Include = "#include \"ecat_modelica.h\"",
        IncludeDirectory = "modelica://EtherCAT/Resources/Include",
        Library = "ecat",
        LibraryDirectory = "modelica://EtherCAT/Resources/Library");
  end destructor;
end SDO;
