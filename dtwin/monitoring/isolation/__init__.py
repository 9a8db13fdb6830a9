"""What isolation weighs: the candidates of a diagnosis against each other."""
