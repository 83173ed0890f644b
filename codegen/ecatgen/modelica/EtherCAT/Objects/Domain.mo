within EtherCAT.Objects;
class Domain "Slaves of a model that are sampled together"
  extends ExternalObject;

  function constructor "Register a domain"
    input EtherCAT.Objects.Master master "Connection";
    input Integer domainID "Number of the domain, 1 first";
    input String instance = "" "Name of the instance of the block, for messages";
    output Domain domain "Domain";
    external "C" domain = ecatm_domain_open(master, domainID, instance)
      annotation (
        Include = "#include \"ecat_modelica.h\"",
        IncludeDirectory = "modelica://EtherCAT/Resources/Include",
        Library = "ecat",
        LibraryDirectory = "modelica://EtherCAT/Resources/Library");
  end constructor;

  function destructor "Release it"
    input Domain domain "Domain";
    external "C" ecatm_domain_close(domain)
      annotation (
        Include = "#include \"ecat_modelica.h\"",
        IncludeDirectory = "modelica://EtherCAT/Resources/Include",
        Library = "ecat",
        LibraryDirectory = "modelica://EtherCAT/Resources/Library");
  end destructor;

  annotation (Documentation(info = "<html>
<p>
Slaves whose blocks are sampled at the same instants. It is an error if <code>domainID</code> is larger than
the number of sample times of the master.
</p>
</html>"));
end Domain;
