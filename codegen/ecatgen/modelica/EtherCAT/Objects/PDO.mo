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
    input String unit = "" "Unit of the physical value";
    output PDO pdo "Entry";
    external "C" pdo = ecatm_pdo_open(slaveConfiguration, index, subindex, isOutput, dataType, bitLength, scale, offset, unit)
      annotation (
        Include = "#include \"ecat_modelica.h\"",
        IncludeDirectory = "modelica://EtherCAT/Resources/Include",
        Library = "ecat",
        LibraryDirectory = "modelica://EtherCAT/Resources/Library");
  end constructor;

  function destructor "Release it"
    input PDO pdo "Entry";
    external "C" ecatm_pdo_close(pdo)
      annotation (
        Include = "#include \"ecat_modelica.h\"",
        IncludeDirectory = "modelica://EtherCAT/Resources/Include",
        Library = "ecat",
        LibraryDirectory = "modelica://EtherCAT/Resources/Library");
  end destructor;

  annotation (Documentation(info = "<html>
<p>
One entry of the process data, by index and subindex. When there is a bus, the entry must be there; if the
fingerprint of the slave is not that of the bus, its data type and number of bits must be the expected ones,
too. If the slave has a fingerprint at all, <code>scale</code>, <code>offset</code> and <code>unit</code> must be those
of the bus. A block that was written by hand has no fingerprint, and defines these three itself.
</p>
<p>
<code>dataType</code> is the number of a CoE data type (ETG.1000.6): 1 BOOLEAN, 2 INTEGER8, 3 INTEGER16, 4
INTEGER32, 5 UNSIGNED8, 6 UNSIGNED16, 7 UNSIGNED32, 8 REAL32, 17 REAL64, and others. A physical value is the
raw value times <code>scale</code> plus <code>offset</code>. With one of them, or a <code>unit</code>, the entry is an
analog quantity: a written value beyond its limits is cut to them, and not refused.
</p>
</html>"));
end PDO;
