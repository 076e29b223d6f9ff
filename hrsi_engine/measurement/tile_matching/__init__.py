"""Two tiles of images matched where their RPCs say that they show the same ground."""
