"""Fields that lie side by side in a message, taken together: one numpy call then serves them all."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from schemas.wire.layout import Layout, Leaf, Node, Rows, read_node

Paths = tuple[str, ...]
Blocks = dict[Paths, NDArray[Any]]
"""(n, ...) values by the paths of the columns in them: one path is the column itself, of k paths each is one of k."""


@dataclass(frozen=True)
class Block:
    """Neighbouring fields of one type in the same message, such as x, y and z, read as one array."""

    paths: Paths
    node: Node


def blocks_of(layout: Layout, wanted: Collection[str] | None) -> list[Block]:
    """The wanted leaves (by path or by the path of a message around them; None: all) of a layout, in its order."""
    blocks: list[Block] = []
    for path, node in layout.leaves.items():
        if wanted is not None and not is_wanted(path, wanted):
            continue
        if blocks and (joined := _joined(blocks[-1], path, node)) is not None:
            blocks[-1] = joined
        else:
            blocks.append(Block((path,), node))
    return blocks


def is_wanted(path: str, wanted: Collection[str]) -> bool:
    """Whether a path or the path of a message around it is among those wanted."""
    while path not in wanted:
        path, dot, _ = path.rpartition(".")
        if not dot:
            return False
    return True


def read_block(block: Block, rows: Rows, base: int) -> NDArray[Any]:
    """(n, ...) values in rows of one layout, whose bodies start at byte base. May be a view of rows."""
    return read_node(block.node, rows, base)


def split(blocks: Blocks) -> dict[str, NDArray[Any]]:
    """The columns of blocks, views of them."""
    columns: dict[str, NDArray[Any]] = {}
    for paths, values in blocks.items():
        columns |= {paths[0]: values} if len(paths) == 1 else {path: values[:, k] for k, path in enumerate(paths)}
    return columns


def _joined(block: Block, path: str, node: Node) -> Block | None:
    """The block with one more field behind it; None where that does not lie right behind it or is of another kind."""
    before = block.node
    if not (_is_number(before) and _is_number(node)) or node.count is not None or before.dtype != node.dtype:
        return None
    count = len(block.paths)
    is_array = count == 1 and before.count is not None
    if is_array or _parent(path) != _parent(block.paths[0]):
        return None
    if node.offset != before.offset + count * node.dtype.itemsize:
        return None
    return Block((*block.paths, path), Leaf("primitive", node.dtype, before.offset, count + 1))


def _is_number(node: Node) -> TypeGuard[Leaf]:
    return isinstance(node, Leaf) and node.kind == "primitive" and not node.ragged and node.dtype != np.bool_


def _parent(path: str) -> str:
    return path.rpartition(".")[0]
