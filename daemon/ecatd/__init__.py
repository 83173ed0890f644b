"""The EtherCAT daemon: bus server, gateway, command line and the data they share."""
