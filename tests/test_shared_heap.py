"""All threads of a command take memory from one heap: what one frees is there for the others."""

import platform
import subprocess
import sys

import pytest

#: How many heaps there are after two threads at once took some memory, as glibc tells it.
COUNT = """
import ctypes, os, tempfile
from threading import Barrier, Thread
from hrsi.hrsi_engine.foundation.shared_heap import share_one_heap

{call}
libc = ctypes.CDLL(None)
libc.malloc.restype = libc.fopen.restype = ctypes.c_void_p
libc.malloc.argtypes, libc.fopen.argtypes = [ctypes.c_size_t], [ctypes.c_char_p] * 2
libc.malloc_info.argtypes, libc.fclose.argtypes = [ctypes.c_int, ctypes.c_void_p], [ctypes.c_void_p]
both = Barrier(2)
threads = [Thread(target=lambda: (both.wait(), libc.malloc(50_000), both.wait())) for _ in range(2)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
with tempfile.NamedTemporaryFile() as file:
    stream = libc.fopen(file.name.encode(), b"w")
    libc.malloc_info(0, stream)
    libc.fclose(stream)
    print(file.read().count(b"<heap nr"))
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only glibc gives each thread a heap")
def test_threads_share_one_heap():
    heaps = {
        call: int(
            subprocess.run([sys.executable, "-c", COUNT.format(call=call)], capture_output=True, check=True).stdout
        )
        for call in ("", "share_one_heap()")
    }
    assert heaps[""] > 1
    assert heaps["share_one_heap()"] == 1
