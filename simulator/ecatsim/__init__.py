"""An EtherCAT segment in software."""
