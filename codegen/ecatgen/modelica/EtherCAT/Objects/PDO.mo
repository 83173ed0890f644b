within EtherCAT.Objects;
class PDO "One entry of the process data of a slave"
  extends ExternalObject;

  function constructor "Find the entry in the process data"
    input EtherCAT.Objects.SlaveConfiguration slaveConfiguration "Slave";
    input Integer index "Index of the object";
    input Integer subindex "Subindex of the object";
    input Boolean isOutput "= true, if the entry is written by the master";
    input Integer dataType "Expected CoE data type";
    input Integer bitLength "Expected number of bits";
    input Real scale = 1 "Physical value = raw value * scale + offset";
    input Real offset = 0 "See scale, in the unit of the physical value";
    output PDO pdo;
    external "C" pdo = ecatm_pdo_open(slaveConfiguration, index, subindex, isOutput, dataType, bitLength, scale, offset)
      annotation (
        Include = "#include \"ecat_modelica.h\"",
        IncludeDirectory = "modelica://EtherCAT/Resources/Include",
        Library = "ecat",
        LibraryDirectory = "modelica://EtherCAT/Resources/Library");
  end constructor;

  function destructor "Release it"
    input PDO pdo;
    external "C" ecatm_pdo_close(pdo)
      annotation (
        Include = "#include \"ecat_modelica.h\"",
        IncludeDirectory = "modelica://EtherCAT/Resources/Include",
        Library = "ecat",
        LibraryDirectory = "modelica://EtherCAT/Resources/Library");
  end destructor;
end PDO;
