"""What every store must do; run on the store on disk and on the one in memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from nurbs_cache.errors import CacheError, CorruptRecordError, MissingRecordError, UsageError
from nurbs_cache.face_record import FACE_REPORT_DTYPE
from nurbs_cache.keys import number_key, tile_key
from nurbs_cache.memory_store import MemoryStore
from nurbs_cache.node_record import ITEM_DTYPE, LOD_DTYPE, NODE_DTYPE
from nurbs_cache.scene_record import OCCURRENCE_DTYPE, Material, PartInfo, Product
from nurbs_cache.store import Store
from nurbs_cache.surface_record import SURFACE_DTYPE, GeometryBatch
from nurbs_cache.typed_store import TypedStore
from tests.cache.makers import geometry, node_rows, small_tile

AnyStore = TypedStore
Maker = Callable[[], AnyStore]


@pytest.fixture(params=["lmdb", "memory"])
def make(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Maker]:
    """Makes empty stores of one kind; closes them."""
    made: list[AnyStore] = []

    def maker() -> AnyStore:
        made.append(Store.create(tmp_path / f"s{len(made)}") if request.param == "lmdb" else MemoryStore())
        return made[-1]

    yield maker
    for store in made:
        store.close()


@pytest.fixture
def store(make: Maker) -> AnyStore:
    return make()


# raw tables


def test_put_get_scan_delete(store: AnyStore) -> None:
    store.put_many("tiles", [(b"b", b"2"), (b"a", b"1"), (b"ab", b"3"), (b"b", b"4")])
    assert store.get("tiles", b"b") == b"4"
    assert list(store.scan("tiles")) == [(b"a", b"1"), (b"ab", b"3"), (b"b", b"4")]
    assert list(store.scan("tiles", b"a")) == [(b"a", b"1"), (b"ab", b"3")]
    store.delete_many("tiles", [b"a", b"absent"])
    assert list(store.scan_keys("tiles")) == [b"ab", b"b"]
    assert store.find("tiles", b"a") is None
    with pytest.raises(MissingRecordError, match="nothing under 61"):
        store.get("tiles", b"a")


def test_values_may_be_empty(store: AnyStore) -> None:
    store.put_many("tiles", [(b"k", b"")])
    assert store.find("tiles", b"k") == b""


def test_unknown_table(store: AnyStore) -> None:
    for use in (lambda: store.find("nope", b"k"), lambda: store.put_many("nope", [(b"k", b"v")])):
        with pytest.raises(CacheError, match="no table 'nope'"):
            use()


def test_transaction_is_all_or_nothing(store: AnyStore) -> None:
    before = store.revision()

    def change(writing: object) -> None:
        writing.put("tiles", b"k", b"v")  # type: ignore[attr-defined]
        assert writing.find("tiles", b"k") == b"v"  # type: ignore[attr-defined]
        raise RuntimeError("stop")

    with pytest.raises(RuntimeError):
        store.transact(change)
    assert store.find("tiles", b"k") is None
    assert store.revision() == before
    store.put_many("tiles", [(b"k", b"v")])
    assert store.revision() > before


def test_transaction_sees_itself(store: AnyStore) -> None:
    store.put_many("tiles", [(b"a", b"1"), (b"b", b"2")])

    def change(writing: object) -> list[bytes]:
        writing.delete("tiles", b"a")  # type: ignore[attr-defined]
        writing.put("tiles", b"c", b"3")  # type: ignore[attr-defined]
        keys: list[bytes] = writing.keys("tiles")  # type: ignore[attr-defined]
        writing.clear("tiles")  # type: ignore[attr-defined]
        return keys

    assert store.transact(change) == [b"b", b"c"]
    assert list(store.scan("tiles")) == []


def test_scan_survives_changes(store: AnyStore) -> None:
    store.put_many("tiles", ((number_key(i), b"x" * 100) for i in range(10_000)))
    seen = 0
    for key, _ in store.scan("tiles"):
        if seen % 200 == 0:
            store.delete_many("tiles", [key])
        seen += 1
    assert seen == 10_000
    assert store.counts()["tiles"] == 9950


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(st.booleans(), st.binary(min_size=1, max_size=3), st.binary(max_size=40)), max_size=30))
def test_like_a_dictionary(store: AnyStore, steps: list[tuple[bool, bytes, bytes]]) -> None:
    store.transact(lambda writing: writing.clear("tiles"))
    model: dict[bytes, bytes] = {}
    for is_put, key, value in steps:
        if is_put:
            store.put_many("tiles", [(key, value)])
            model[key] = value
        else:
            store.delete_many("tiles", [key])
            model.pop(key, None)
    assert list(store.scan("tiles")) == sorted(model.items())
    assert list(store.scan("tiles", b"a")) == sorted((k, v) for k, v in model.items() if k.startswith(b"a"))


def test_closed(store: AnyStore) -> None:
    store.close()
    store.close()
    with pytest.raises(CacheError, match="closed"):
        store.find("tiles", b"k")


# parts


def test_parts_round_trip(store: AnyStore) -> None:
    parts = [(i, PartInfo(f"part ß {i}", 3, 3 * i), geometry(3, seed=i)) for i in range(5)]
    store.put_parts(iter(parts))
    assert store.part_infos() == [info for _, info, _ in parts]
    assert store.part_numbers() == [0, 1, 2, 3, 4]
    for index, _, batch in parts:
        assert store.get_part(index).to_bytes() == batch.to_bytes()


def test_locate_surface(store: AnyStore) -> None:
    counts = [2, 0, 3, 0, 0, 1]
    firsts = np.concatenate([[0], np.cumsum(counts)])
    store.put_parts((i, PartInfo("p", n, int(firsts[i])), geometry(n)) for i, n in enumerate(counts))
    assert [store.locate_surface(s) for s in range(6)] == [(0, 0), (0, 1), (2, 0), (2, 1), (2, 2), (5, 0)]
    for absent in (-1, 6, 2**40):
        with pytest.raises(MissingRecordError, match="no surface"):
            store.locate_surface(absent)


def test_infos_follow_new_parts(store: AnyStore) -> None:
    assert store.part_infos() == []
    with pytest.raises(MissingRecordError):
        store.locate_surface(0)
    store.put_parts([(0, PartInfo("a", 1, 0), geometry(1))])
    assert store.locate_surface(0) == (0, 0)
    store.put_parts([(1, PartInfo("b", 1, 1), geometry(1))])
    assert store.locate_surface(1) == (1, 0)


def test_part_of_wrong_size(store: AnyStore) -> None:
    with pytest.raises(UsageError, match="2 surfaces, its info says 3"):
        store.put_parts([(0, PartInfo("p", 3, 0), geometry(2))])
    with pytest.raises(MissingRecordError, match="no part 0"):
        store.get_part(0)


def test_damaged_part(store: AnyStore) -> None:
    store.put_parts([(0, PartInfo("p", 2, 0), geometry(2))])
    data = bytearray(store.get("parts", number_key(0)))
    data[-1] ^= 1
    store.put_many("parts", [(number_key(0), bytes(data))])
    with pytest.raises(CorruptRecordError, match="part 0: checksum"):
        store.get_part(0)


# scene


def test_scene_round_trip(store: AnyStore) -> None:
    products = [Product("Wurzel Ä", -1, tuple(map(float, range(12)))), Product("leaf", 0, (0.1,) * 12)]
    materials = [Material("red", (1.0, 0.1, 0.2, 0.3)), Material("", (0.0, 0.0, 0.0, 1.0))]
    occurrences = np.zeros(2, OCCURRENCE_DTYPE)
    occurrences["transform"] = np.arange(24).reshape(2, 3, 4)
    occurrences["material"] = -1
    store.put_scene(products, materials, occurrences, {"file": "inch", "mm": 25.4})
    assert store.get_products() == products
    assert store.get_materials() == materials
    assert (store.get_occurrences() == occurrences).all()
    assert store.get_units() == {"file": "inch", "mm": 25.4}


def test_scene_empty(store: AnyStore) -> None:
    assert (store.get_products(), store.get_materials(), store.get_units()) == ([], [], {})
    assert len(store.get_occurrences()) == 0
    store.put_scene([], [], np.zeros(0, OCCURRENCE_DTYPE), {})
    assert (store.get_products(), store.get_materials()) == ([], [])
    assert len(store.get_occurrences()) == 0


# tree


@pytest.mark.parametrize("n", [0, 1, 255, 256, 257, 1000])
def test_tree_round_trip(store: AnyStore, n: int) -> None:
    nodes, items = node_rows(n), np.zeros(2 * n, ITEM_DTYPE)
    items["surface"] = np.arange(2 * n)
    store.put_tree(nodes, items, {"r": 200, "levels": [1, 2]})
    assert (store.get_nodes() == nodes).all()
    assert (store.get_items() == items).all()
    assert (store.n_nodes(), store.n_items()) == (n, 2 * n)
    assert store.tree_params() == {"r": 200, "levels": [1, 2]}
    for first, count in ((0, 0), (0, 300), (250, 20), (n, 5), (n + 7, 3)):
        assert (store.get_nodes(first, count) == nodes[first : first + count]).all()


def test_tree_shrinks(store: AnyStore) -> None:
    store.put_tree(node_rows(1000), np.zeros(1000, ITEM_DTYPE))
    store.put_tree(node_rows(3), np.zeros(2, ITEM_DTYPE))
    assert len(store.get_nodes()) == 3
    assert store.counts()["nodes"] == store.counts()["items"] == 1


def test_update_nodes(store: AnyStore) -> None:
    nodes = node_rows(1000)
    store.put_tree(nodes, np.zeros(0, ITEM_DTYPE))
    rows = np.array([999, 0, 300, 301])
    nodes["tile_bytes"][rows] = [1, 2, 3, 4]
    store.update_nodes(rows, nodes[rows])
    assert (store.get_nodes() == nodes).all()
    nodes["tile_bytes"][5] = 77
    store.update_nodes(5, nodes[5])
    assert (store.get_nodes() == nodes).all()
    store.update_nodes([], nodes[:0])


def test_update_nodes_refuses(store: AnyStore) -> None:
    store.put_tree(node_rows(3), np.zeros(0, ITEM_DTYPE))
    for rows, n in (([3], 1), ([-1], 1), ([0, 1], 1)):
        with pytest.raises(UsageError):
            store.update_nodes(rows, node_rows(n))
    with pytest.raises(UsageError, match="negative"):
        store.get_nodes(-1)
    with pytest.raises(UsageError, match="fields"):
        store.put_tree(np.zeros(1, ITEM_DTYPE), np.zeros(0, ITEM_DTYPE))


# tiles, levels of detail, faces


def test_tiles(store: AnyStore) -> None:
    name, data = small_tile()
    assert not store.has_tile(name)
    with pytest.raises(MissingRecordError, match=f"no tile {name}"):
        store.get_tile(name)
    store.put_tiles([(name, data)])
    assert store.has_tile(name)
    assert store.get_tile(name) == store.get_tile(name.encode()) == data
    with pytest.raises(UsageError, match="32 lower-case hex"):
        store.get_tile("xyz")


def test_damaged_tile(store: AnyStore) -> None:
    name, data = small_tile()
    store.put_tiles([(name, data[:-5] + bytes([data[-5] ^ 4]) + data[-4:])])
    with pytest.raises(CorruptRecordError, match=f"tile {name}: checksum"):
        store.get_tile(name)


def test_lods(store: AnyStore) -> None:
    assert len(store.get_lods(7)) == 0
    rows = np.zeros(3, LOD_DTYPE)
    rows["level"] = [2, -1, 0]
    rows["n_triangles"] = [10, 20, 30]
    store.put_lods(7, rows[:2])
    store.put_lods(7, rows[2])
    replaced = rows[1].copy()
    replaced["n_triangles"] = 99
    store.put_lods(7, replaced)
    assert store.get_lods(7)["level"].tolist() == [-1, 0, 2]
    assert store.get_lods(7)["n_triangles"].tolist() == [99, 30, 10]
    assert len(store.get_lods(8)) == 0


def test_face_report(store: AnyStore) -> None:
    assert len(store.get_face_report()) == 0
    rows = np.zeros(10_000, FACE_REPORT_DTYPE)
    rows["surface"] = np.arange(10_000)[::-1]
    rows["certified"] = np.arange(10_000) / 7
    store.put_face_report(rows[:6000])
    store.put_face_report(rows[4000:])
    assert (store.get_face_report() == rows[::-1]).all()


# content hash


def _fill(store: AnyStore, order: int = 1) -> None:
    name, data = small_tile()
    store.put_tiles([(name, data)])
    parts = [(i, PartInfo(f"{i}", 2, 2 * i), geometry(2, seed=i)) for i in range(4)]
    for part in parts[::order]:
        store.put_parts([part])
    nodes = node_rows(300)
    nodes["tile_hash"][299] = name.encode()
    store.put_tree(nodes, np.zeros(7, ITEM_DTYPE), {"a": 1, "b": 2})
    store.put_scene([Product("p", -1, (1.0,) * 12)], [], np.zeros(3, OCCURRENCE_DTYPE), {"file": "mm"})
    store.put_face_report(np.zeros(1, FACE_REPORT_DTYPE))


def test_content_hash_follows_content_only(make: Maker) -> None:
    first, second = make(), make()
    _fill(first)
    second.put_tree(node_rows(2000), np.zeros(0, ITEM_DTYPE))  # replaced below
    _fill(second, order=-1)
    lod = np.zeros(1, LOD_DTYPE)
    second.put_lods(3, lod)
    assert first.content_hash() == second.content_hash()
    in_memory = MemoryStore(provenance={"when": "later", "where": "elsewhere"})
    _fill(in_memory)
    assert in_memory.content_hash() == first.content_hash()
    assert first.check()["parts"] == 4


def test_content_hash_sees_every_table(store: AnyStore) -> None:
    _fill(store)
    seen = {store.content_hash()}
    changes: list[Callable[[], None]] = [
        lambda: store.put_parts([(0, PartInfo("0", 2, 0), geometry(2, seed=99))]),
        lambda: store.put_parts([(0, PartInfo("renamed", 2, 0), geometry(2, seed=99))]),
        lambda: store.update_nodes(17, node_rows(1)),
        lambda: store.put_tree(store.get_nodes(), store.get_items(), {"a": 2}),
        lambda: store.put_tree(store.get_nodes(), np.zeros(8, ITEM_DTYPE), {"a": 2}),
        lambda: store.put_scene([], [], np.zeros(0, OCCURRENCE_DTYPE), {"file": "mm"}),
        lambda: store.put_scene([], [], np.zeros(0, OCCURRENCE_DTYPE), {"file": "inch"}),
        lambda: store.put_face_report(np.ones(1, FACE_REPORT_DTYPE)),
    ]
    for change in changes:
        change()
        seen.add(store.content_hash())
    assert len(seen) == len(changes) + 1


def test_content_hash_ignores_padding(make: Maker) -> None:
    hashes = set()
    for fill in (0, 255):
        batch = geometry(2)
        dirty = np.frombuffer(bytearray([fill]) * batch.surfaces.nbytes, SURFACE_DTYPE)
        for field in SURFACE_DTYPE.names or ():
            dirty[field] = batch.surfaces[field]
        store = make()
        arrays = (batch.loops, batch.coedges, batch.edges, batch.curves, batch.vertices, batch.values, batch.sources)
        store.put_parts([(0, PartInfo("p", 2, 0), GeometryBatch(dirty, *arrays))])
        nodes = np.frombuffer(bytearray([fill]) * NODE_DTYPE.itemsize, NODE_DTYPE)
        for field in NODE_DTYPE.names or ():
            nodes[field] = node_rows(1)[field]
        store.put_tree(nodes, np.zeros(0, ITEM_DTYPE))
        hashes.add(store.content_hash())
    assert len(hashes) == 1


def test_check_finds_what_is_wrong(store: AnyStore) -> None:
    _fill(store)
    name, data = small_tile()
    store.delete_many("tiles", [tile_key(name)])
    with pytest.raises(CorruptRecordError, match=f"tile {name} is not stored"):
        store.content_hash()
    store.put_many("tiles", [(tile_key("0" * 32), data), (tile_key(name), data)])
    with pytest.raises(CorruptRecordError, match="not the one its name says"):
        store.check()
