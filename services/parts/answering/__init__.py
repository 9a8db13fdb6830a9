"""What the bridge has to answer samples with: the connection to a controller, and the way that its path goes on."""
