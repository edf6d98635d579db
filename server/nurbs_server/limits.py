"""Every number the server could be tuned by, with its unit and the reason for its value."""

from __future__ import annotations

READ_THREADS = 8  # cold reads wait for the disk, not for the processor: a few may wait side by side
READ_QUEUE = 4096  # reads; more than a full batch for each of a dozen clients, then 503
BUILD_THREADS = 1  # builds are compute; one leaves the other core of a small machine to the event loop
BUILD_QUEUE = 256  # builds; at some 50 ms each the last in line waits about as long as a client will

TILE_CACHE_BYTES = 128 << 20  # checked tiles kept ready: some 4,000 of the usual 30 KiB
PART_CACHE_BYTES = 256 << 20  # decoded parts: a viewer asks for many surfaces of one part in a row

BATCH_TILES = 256  # hashes in one batch; at 30 KiB a tile a response of about 8 MiB
BATCH_CHUNK = 16  # tiles that are read side by side and sent together: bounds the memory of a batch, some 500 KiB
BODY_BYTES = 64 << 10  # largest request body; a full batch is about 9 KiB
JSON_ROWS = 10_000  # rows of a table as JSON: meant for people; programs read the raw rows
CONTENT_HASH_WAIT_S = 2.0  # seconds that /api/scene waits for it: enough for some 500 MB, and for patience

LOD_LEVELS = (-20, 20)  # ladder levels that may be asked for: 2**-20 mm is a nanometre, 2**20 mm a kilometre

CORS_MAX_AGE_S = 86_400  # browsers keep the answer to a preflight for a day (and cap it themselves)
SHUTDOWN_GRACE_S = 0.4  # seconds that a running response may still take when the server is told to stop
