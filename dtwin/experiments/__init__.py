"""Every claim that is measured: experiments with reports, benchmarks, validation."""
