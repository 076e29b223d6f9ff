"""The declaration of algorithms and their options, and the check of options."""
