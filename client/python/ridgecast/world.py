"""A session of a server, joined as a member."""

import json
import math
import uuid
import weakref
from dataclasses import dataclass
from typing import Any, Callable, List, Mapping, Optional, Tuple, Union
from urllib.parse import quote

import numpy as np

from ._errors import Invalid
from ._library import check, ffi, in_slices, interruptible, lib, owned, struct, text, usable
from .mesh import Mesh, take
from .standing import Standing
from .terrain import Questions, Terrain


@dataclass(frozen=True)
class Iteration:
    """What the server made for a pose: the mesh held is the one with this hash."""

    number: int
    pose: int  #: the pose that it was made for, from 1 on
    hash: int
    triangles: int
    threshold: float  #: pixels: the error that was reached
    settled: bool  #: nothing is left to refine at this pose


@dataclass(frozen=True)
class Leaf:
    """A square of the mesh held; its corner of least x and z is at (i, j) * side."""

    level: int
    i: int
    j: int
    side: float  #: metres
    version: int  #: grows whenever its triangles change
    triangles: int


@dataclass(frozen=True)
class Member:
    """Another member of the session."""

    number: int
    name: str
    sensor: bool
    position: Optional[Tuple[float, float, float]]  #: x, y, z, metres; None: no pose yet
    yaw: float
    pitch: float
    time: float  #: session time of the pose, seconds
    state: bytes  #: what it sent with its pose


@dataclass(frozen=True)
class Cell:
    """A square with members in it."""

    x: float  #: of its corner of least x and z, metres
    z: float
    side: float  #: metres
    members: int


class Clock:
    """The session's clock: seconds since its beginning. One member owns it: the first to set or step it."""

    MODES = ("real-time", "scaled", "stepped")

    def __init__(self, world: "World") -> None:
        self._of = weakref.ref(world)

    @property
    def _world(self) -> "World":
        world = self._of()
        if world is None:
            raise Invalid("this clock's world is closed")
        return world

    def _state(self) -> Any:
        out = struct("rc_clock")
        check(lib.rc_world_clock(self._world._handle, out))
        return out

    @property
    def time(self) -> float:
        """Seconds now; exact while the clock is stepped."""
        return float(self._state().time) * 1e-6

    @property
    def uncertainty(self) -> float:
        """How many seconds `time` may be off."""
        return float(self._state().uncertainty) * 1e-6

    @property
    def mode(self) -> str:
        return self.MODES[self._state().mode]

    @property
    def end(self) -> Optional[float]:
        """Of a recording, the time at which its clock stands; None: this is no recording."""
        return self._state().end * 1e-6 or None

    @property
    def owner(self) -> Optional[int]:
        """The number of the member that owns the clock; None: nobody."""
        return int(self._state().owner) or None

    def set(self, mode: str, rate: float = 1.0, timeout: float = 10.0) -> None:
        """Takes the clock if nobody owns it, and sets it: "real-time", "scaled" by `rate`, or "stepped"."""
        if mode not in self.MODES:
            raise Invalid(f"a clock is one of {', '.join(self.MODES)}, not {mode!r}")
        interruptible(lambda: lib.rc_world_set_clock(self._world._handle, self.MODES.index(mode), rate, timeout))

    def jump(self, seconds: float, timeout: float = 10.0) -> None:
        """Takes the clock if nobody owns it, and moves it to this time: ahead by at most an hour, or, in a recording, back.

        A recording then begins again there, and the connection with it. Raises Refused while a step is under way.
        """
        interruptible(lambda: lib.rc_world_jump(self._world._handle, round(seconds * 1e6), timeout))

    def step(self, seconds: float, timeout: float = 10.0) -> None:
        """Takes the clock if nobody owns it, advances it, and waits until all members that follow it have done the step.

        Raises Timeout, which names those that have not; the step is then still under way, and step(0) waits for it again. After Refused
        there is no step. Lost: whether it was done is unknown, read the clock; or the server has lost the clock, which has begun anew,
        and there is no step. That is raised once, by whichever of set, jump, step and next is called first.
        """
        step = round(seconds * 1e6)
        if seconds != 0 and step < 1:
            raise Invalid("a step is 1 microsecond to 1 hour")

        def once(slice: float) -> None:
            nonlocal step
            now, step = step, 0
            check(lib.rc_world_step(self._world._handle, now, slice))

        in_slices(once, timeout)

    def next(self, timeout: float = 10.0) -> float:
        """For a member that follows: reports the step returned last as done, waits for the next one, and returns the session's time."""
        out = ffi.new("int64_t*")
        in_slices(lambda slice: check(lib.rc_world_next_step(self._world._handle, slice, out)), timeout)
        return float(out[0]) * 1e-6

    def pass_over(self, member: int) -> None:
        """For the owner: no step waits for this member until it has caught up."""
        check(lib.rc_world_pass_over(self._world._handle, member))


class World(Questions):
    """A session's world, as one of its members. Made by `join`; a context manager that leaves the session at its end."""

    def __init__(self, handle: Any) -> None:
        self._open = handle
        self._standings: "weakref.WeakSet[Standing]" = weakref.WeakSet()
        self._last = struct("rc_iteration")  # the one that came last
        info = self._info()
        self.session: str = ffi.string(info.session).decode()
        self.terrain: str = ffi.string(info.terrain).decode()
        self.seed: int = info.seed
        self.horizon: float = info.horizon  #: metres
        self.is_local: bool = bool(info.is_local)  #: True: heights are computed here; False: the server is asked
        self.clock = Clock(self)

    @property
    def _handle(self) -> Any:
        return usable(self._open, "world")

    @property
    def _terrain(self) -> Any:
        handle = self._handle
        return ffi.gc(lib.rc_world_terrain(handle), lambda _, handle=handle: None)  # keeps the world alive

    def _call(self, count: int, call: Callable[[int, int], Any]) -> None:
        if self.is_local:
            super()._call(count, call)
        else:
            interruptible(lambda: call(0, count))

    def _stand(self, ground: Standing) -> None:
        self._standings.add(ground)

    def _info(self) -> Any:
        out = struct("rc_world_info")
        check(lib.rc_world_get_info(self._handle, out))
        return out

    @property
    def hash(self) -> int:
        """Equal for equal ground, on every machine: the terrain's hash, and after each edit, an undo too, another one."""
        return int(lib.rc_terrain_hash(self._terrain))

    @property
    def member(self) -> int:
        """This member's number; another one after a reconnection."""
        return int(self._info().member)

    @property
    def reconnections(self) -> int:
        return int(self._info().reconnections)

    @property
    def members(self) -> List[Member]:
        """The other members near this one: the 64 nearest and a few more. The 24 nearest are up to date to a tenth of a second, the others
        to a second or a few. For the owner of a stepped clock and those who follow it they are as of the step. Everybody, if the session has at most 65 members or this one joined with everybody=True.
        """
        def member(m: Any) -> Member:
            return Member(m.member, ffi.string(m.name).decode(errors="replace"), bool(m.sensor), (m.x, m.y, m.z) if m.has_pose else None,
                          m.yaw, m.pitch, m.time * 1e-6, bytes(ffi.buffer(m.state, m.state_size)))

        return self._all("rc_member", lib.rc_world_members, member)

    @property
    def crowd(self) -> List[Cell]:
        """How many members, this one included, are where, in at most 512 squares, to two seconds. Empty while `members` names everybody."""
        return self._all("rc_crowd_cell", lambda *a: lib.rc_world_crowd(*a, ffi.NULL), lambda c: Cell(c.x, c.z, c.side, int(c.members)))

    @property
    def others(self) -> int:
        """How many other members the session has, named in `members` or not."""
        count, others = ffi.new("size_t*"), ffi.new("uint64_t*")
        check(lib.rc_world_crowd(self._handle, ffi.NULL, 0, count, others))
        return int(others[0])

    def ground(self, center: Tuple[float, float], radius: float, error: float, timeout: float = 40.0) -> Mesh:
        """The ground in a circle as triangles, at most `error` metres off; the mesh's origin is the center (x, z).

        Raises Refused if that takes too many triangles; the message says which error fits.
        """
        x, z = map(float, center)
        out = ffi.new("const rc_mesh**")
        interruptible(lambda: lib.rc_world_ground(self._handle, x, z, radius, error, timeout, out), lambda: lib.rc_mesh_close(out[0]))
        return take(out[0])

    def edit(self, op: str, *, key: Optional[str] = None, timeout: float = 10.0, **fields: Any) -> int:
        """Changes the ground for everybody, such as edit("crater", x=0, z=0, radius=12, depth=4). Returns the edit's number.

        op: raise, lower, crater, level, smooth, road, stamp or undo, with their fields in metres (PROTOCOL.md, Edits). Then it is kept, and
        heights and meshes know it. key: an edit that is sent again with it is made once. Raises Refused, with the server's sentence.
        """
        operation = json.dumps({"op": op, **fields}, default=_plain).encode()
        name = (key or uuid.uuid4().hex).encode()
        out = ffi.new("uint64_t*")
        in_slices(lambda slice: check(lib.rc_world_edit(self._handle, operation, name, slice, out)), timeout)
        return int(out[0])

    def undo(self, edit: int, timeout: float = 10.0) -> int:
        """Undoes the edit of this number, as if it had not been. Returns the number of the undo, which can be undone as well."""
        return self.edit("undo", edit=edit, timeout=timeout)

    def place(self, x: float, y: float, z: float, yaw: float = 0.0, pitch: float = 0.0, *, fov: float = math.radians(60),
              width: int = 1280, height: int = 720, state: bytes = b"") -> int:
        """Sends where this member is, and processes what has come for it; never waits. Returns the pose's number.

        yaw 0 looks along -Z, and yaw grows to the left; pitch grows upwards; fov is vertical. state: at most 256 bytes for the others.
        """
        kept = ffi.new("uint8_t[]", state)
        pose = struct("rc_camera", x=x, y=y, z=z, yaw=yaw, pitch=pitch, vertical_fov=fov, width=width, height=height, state=kept,
                      state_size=len(state))
        out = struct("rc_iteration")
        check(lib.rc_world_fly(self._handle, pose, 0, out))
        while lib.rc_world_receive(self._handle, 0, self._last) == lib.RC_OK:
            pass
        return int(out.pose)

    def camera(self, x: float, y: float, z: float, yaw: float = 0.0, pitch: float = 0.0, *, fov: float = math.radians(60),
               width: int = 1280, height: int = 720, state: bytes = b"", timeout: float = 10.0) -> Iteration:
        """Like `place`, but waits until the mesh held is the server's for that pose."""
        number = self.place(x, y, z, yaw, pitch, fov=fov, width=width, height=height, state=state)
        out = self._last

        def wait(slice: float) -> None:
            while out.pose < number:
                check(lib.rc_world_receive(self._handle, slice, out))

        in_slices(wait, timeout)
        return self._iteration(out)

    def receive(self, timeout: float = 10.0) -> Iteration:
        """Waits for the next iteration for the pose sent last: the mesh grows finer until it is settled."""
        in_slices(lambda slice: check(lib.rc_world_receive(self._handle, slice, self._last)), timeout)
        return self._iteration(self._last)

    @staticmethod
    def _iteration(out: Any) -> Iteration:
        return Iteration(out.number, out.pose, out.hash, out.triangles, out.threshold, bool(out.settled))

    def mesh(self, origin: Tuple[float, float] = (0.0, 0.0)) -> Mesh:
        """The whole mesh held."""
        out = ffi.new("const rc_mesh**")
        check(lib.rc_world_mesh(self._handle, origin[0], origin[1], out))
        return take(out[0])

    @property
    def leaves(self) -> List[Leaf]:
        """The squares of the mesh held. To fetch only what has changed, compare versions."""
        return self._all("rc_leaf", lib.rc_world_leaves, lambda l: Leaf(l.level, l.i, l.j, l.side, l.version, l.triangles))

    def leaf(self, leaf: Leaf) -> Mesh:
        """The mesh of one of `leaves`; its origin is its corner."""
        out = ffi.new("const rc_mesh**")
        check(lib.rc_world_leaf(self._handle, leaf.level, leaf.i, leaf.j, out))
        return take(out[0])

    def _all(self, name: str, list_all: Callable[..., Any], one: Callable[[Any], Any]) -> List[Any]:
        count, room = ffi.new("size_t*"), 256
        while True:
            out = ffi.new(f"{name}[]", room)
            out[0].size = ffi.sizeof(name)
            check(list_all(self._handle, out, room, count))
            if count[0] <= room:
                return [one(out[k]) for k in range(count[0])]  # out[k] does not keep the array
            room = 2 * count[0]

    def close(self) -> None:
        """Closes the ground of `standing`, and leaves the session as soon as no call on another thread is under way. Meshes and tiles that
        were taken stay valid."""
        for ground in self._standings:
            ground.close()
        self._open = ffi.NULL

    def __enter__(self) -> "World":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<ridgecast.World {self.session}: {self.terrain}, seed {self.seed}>"


def _plain(value: Any) -> Any:
    """What JSON has for a number or array of numpy."""
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    raise Invalid(f"an edit's fields are numbers, strings and lists, not {type(value).__name__}")


def join(url: str = "ws://127.0.0.1:7070", *, session: Optional[str] = None, terrain: Union[str, Terrain, None] = None,
         seed: Optional[int] = None, parameters: Optional[Mapping[str, float]] = None, clock: Optional[str] = None, name: str = "",
         sensor: bool = False, follow: bool = False, lockstep: bool = False, triangles: int = 0, threshold: float = 0.0,
         token: Optional[str] = None, ca: Optional[str] = None, reconnect: bool = True, timeout: float = 10.0, everybody: bool = False, mesh: bool = True,
         errors: bool = False) -> World:
    """Joins a session; if it does not exist and a terrain is named, the server creates it. A session's height map or terrain file that lies
    here, too, may be given as a `Terrain`: then heights do not ask the server. Raises Refused if it is another.

    clock: with "stepped", the clock of a new session stands at 0 until its first step. sensor: a member without a camera's mesh. follow:
    each step of the clock waits until this member has done it (clock.next). lockstep: one iteration for each pose, the same meshes for the
    same poses. triangles: of the mesh at most; threshold: of the mesh, in pixels; 0: the defaults. reconnect: a lost connection is restored
    by itself, and calls wait for it within their timeout. everybody: `members` names each member, however far: at once if the session has
    at most 64 or its clock is stepped, otherwise far ones seldom. mesh=False: poses only place this member; no iterations come.
    errors: the `error` of the mesh held is known; measuring it takes the server several times what making the mesh takes.
    """
    query: List[str] = []
    if session is not None:
        query.append(f"session={quote(session, safe='')}")
    if terrain is not None and not isinstance(terrain, Terrain):
        query.append(f"terrain={quote(terrain, safe='')}")
    if seed is not None:
        query.append(f"seed={int(seed)}")
    query += [f"param={quote(key, safe='')}={float(value)!r}" for key, value in (parameters or {}).items()]
    if clock is not None:
        query.append(f"clock={quote(clock, safe='')}")
    spelt = text(url + ("&" if "?" in url else "?") * bool(query) + "&".join(query))
    words = text(name), text(token), text(ca)
    options = struct("rc_join_options", name=words[0], token=words[1], ca=words[2], sensor=sensor, follows=follow, lockstep=lockstep,
                     stays_lost=not reconnect, triangles=triangles, threshold=threshold, timeout=timeout, everybody=everybody, places_only=not mesh,
                     errors=errors, terrain=terrain._terrain if isinstance(terrain, Terrain) else ffi.NULL)
    out = ffi.new("rc_world**")
    interruptible(lambda: lib.rc_join(spelt, options, out), lambda: lib.rc_world_close(out[0]))
    return World(owned(out[0], lib.rc_world_close))
