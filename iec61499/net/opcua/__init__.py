"""OPC UA for communication blocks, `opc_ua[...]`: identifiers, values, the device's server, connections to others."""
