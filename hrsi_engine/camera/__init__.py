"""The RPC camera: evaluation, inverse, and the fit of an RPC to correspondences."""

from ..foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, {"rpc": "RPC", "rpc_fit": "RpcFit fit_rpc"})
