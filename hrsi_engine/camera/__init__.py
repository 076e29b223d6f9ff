"""The RPC camera: evaluation, inverse, and the fit of an RPC to correspondences."""
