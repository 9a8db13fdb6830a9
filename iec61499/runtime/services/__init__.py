"""What service interface blocks do beside timing and communication."""
