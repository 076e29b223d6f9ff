"""The RPC camera: evaluation, inverse, and the fit of an RPC to correspondences."""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .rpc import RPC as RPC
from .rpc_fit import RpcFit as RpcFit
from .rpc_fit import fit_rpc as fit_rpc
