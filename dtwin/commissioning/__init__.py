"""The commissioning of an arm as one procedure of stages, which can be interrupted, and its report."""
