"""What an adjustment is turned into: residuals, statistics, figures of the report, tables, layers; each rule once."""
