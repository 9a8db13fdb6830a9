"""The controller of any serial arm: its application of function blocks, made from the library and run."""
