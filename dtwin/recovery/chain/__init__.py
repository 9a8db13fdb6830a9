"""Recovery of any serial arm: what follows from a finding of its monitor, and who carries it out."""
