"""Twin, controller and cell as FMUs (Functional Mock-up Interface, https://fmi-standard.org): C inside, no Python."""
