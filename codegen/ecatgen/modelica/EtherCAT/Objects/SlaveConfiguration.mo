within EtherCAT.Objects;
class SlaveConfiguration "Registration of one slave"
  extends ExternalObject;

  function constructor "Check the identity of a slave and register it"
    input EtherCAT.Objects.Domain domain "Domain of the slave";
    input Integer position "Position on the bus, 0 first";
    input String givenName "Name in the configuration of ecatd, empty: by position";
    input Integer vendorID "Expected vendor ID";
    input Integer productCode "Expected product code";
    input Integer revisionNumber "Expected revision number, 0: any";
    input String name "Expected name, for error messages";
    input String fingerprint "Fingerprint of the bus that the block was generated for";
    input String generateCommand "Command that generates the block again";
    input String instance = "" "Name of the instance of the block, for messages";
    output SlaveConfiguration slaveConfiguration "Slave";
    external "C" slaveConfiguration = ecatm_slave_open(domain, position, givenName, vendorID, productCode, revisionNumber, name, fingerprint, generateCommand, instance)
      annotation (
        Include = "#include \"ecat_modelica.h\"",
        IncludeDirectory = "modelica://EtherCAT/Resources/Include",
        Library = "ecat",
        LibraryDirectory = "modelica://EtherCAT/Resources/Library");
  end constructor;

  function destructor "Release it"
    input SlaveConfiguration slaveConfiguration "Slave";
    external "C" ecatm_slave_close(slaveConfiguration)
      annotation (
        Include = "#include \"ecat_modelica.h\"",
        IncludeDirectory = "modelica://EtherCAT/Resources/Include",
        Library = "ecat",
        LibraryDirectory = "modelica://EtherCAT/Resources/Library");
  end destructor;

  annotation (Documentation(info = "<html>
<p>
The slave that the model expects at a position. When there is a bus, its identity is compared. Another vendor
or product, or another revision unless the expected one is 0, ends the simulation with a message that names
both slaves and the <code>generateCommand</code>.
</p>
<p>
Identity numbers have 32 bits without a sign; a Modelica Integer holds them with one, such as -1 for
0xFFFFFFFF.
</p>
</html>"));
end SlaveConfiguration;
