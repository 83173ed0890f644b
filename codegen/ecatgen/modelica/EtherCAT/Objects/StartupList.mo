within EtherCAT.Objects;
class StartupList "Objects of a slave that are written one after the other"
  extends ExternalObject;

  function constructor "Register a list of objects"
    input EtherCAT.Objects.Master master "Connection";
    input Integer position "Position of the slave on the bus, 0 first";
    input String slaveName "Name of the slave in the configuration of ecatd, empty: by position";
    input Integer table[:, 4]
      "Index, subindex, CoE data type (number of the EtherCAT.Types.DataType) and value of each object";
    input String instance = "" "Name of the instance of the block, for messages";
    output StartupList list "Objects and values";
    external "C" list = ecatm_sdo_list_open(master, position, slaveName, table, size(table, 1), size(table, 2), instance)
      annotation (
        Include = "#include \"ecat_modelica.h\"",
        IncludeDirectory = "modelica://EtherCAT/Resources/Include",
        Library = "ecat",
        LibraryDirectory = "modelica://EtherCAT/Resources/Library");
  end constructor;

  function destructor "Release it"
    input StartupList list "Objects and values";
    external "C" ecatm_sdo_list_close(list)
      annotation (
        Include = "#include \"ecat_modelica.h\"",
        IncludeDirectory = "modelica://EtherCAT/Resources/Include",
        Library = "ecat",
        LibraryDirectory = "modelica://EtherCAT/Resources/Library");
  end destructor;

  annotation (Documentation(info = "<html>
<p>
Objects that are set by SDO before something starts, such as the settings of a drive.
</p>
</html>"));
end StartupList;
