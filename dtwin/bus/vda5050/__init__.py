"""Messages between the control of a fleet and its vehicles in the form of VDA 5050 3.0, whoever made them."""
