"""Make rpcm_projections.json: points projected by rpcm 1.4.10 (PyPI) with its own readers of RPC files.

Run in an environment of its own (numpy < 2, rpcm without its optional elevation service):
``python rpcm_projections.py DATA > rpcm_projections.json``, DATA being the folder of the real data.
"""

import json
import sys
from pathlib import Path

import numpy as np
import rpcm

FILES = (
    "formats/dimap_phr/rpc_PLEIADES.xml", "formats/dimap_spot6/rpc_SPOT6.xml", "formats/wv_isd_xml/rpc_WV2.xml",
    "formats/rpc_txt/rpc_IKONOS.txt", "zy3_stereo_gcp/zy301a_fwd_381_6138_rpc.txt",
    "formats/rpcm_json/JAX_068_001_RGB.json",
)  # fmt: skip


def read(path: Path) -> "rpcm.RPCModel":
    if path.suffix == ".json":
        return rpcm.RPCModel(json.loads(path.read_text())["rpc"], dict_format="rpcm")
    return rpcm.rpc_from_rpc_file(str(path))


def points(rpc: "rpcm.RPCModel") -> dict[str, list[float]]:
    lon = rpc.lon_offset + rpc.lon_scale * np.array([-0.9, 0.0, 0.7])
    lat = rpc.lat_offset + rpc.lat_scale * np.array([-0.8, 0.1, 0.9])
    height = rpc.alt_offset + rpc.alt_scale * np.array([0.5, -1.0, 1.0])
    sample, line = rpc.projection(lon, lat, height)
    columns = {"lon": lon, "lat": lat, "height": height, "sample": sample, "line": line}
    return {name: np.asarray(values, dtype=float).tolist() for name, values in columns.items()}


if __name__ == "__main__":
    json.dump({name: points(read(Path(sys.argv[1]) / name)) for name in FILES}, sys.stdout, indent=1)
