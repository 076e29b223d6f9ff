"""Matching of two image tiles where the RPCs predict the same ground."""
