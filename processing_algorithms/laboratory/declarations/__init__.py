"""What the laboratory's algorithms say of themselves."""
