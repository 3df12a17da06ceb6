"""Several servers of one world behind HAProxy and beside Redis, all as processes. Members place themselves and edit, cameras fly, a stepped
and a real clock run, while each server and then Redis is killed, stopped and out of disk. Judged at the end, and written down for each
phase: one ground everywhere, no acknowledged edit lost and none made twice, members that see their neighbours, meshes that go on.
    servers.py SERVER DOCKER [acceptance|split|steps]      PYTHONPATH has the package of this build
Sizes, from the environment: SERVERS, MEMBERS, CAMERAS, PAUSE (seconds between two failures), OUTAGE (of Redis), ROUNDS (of split and
steps). Times are judged with MEASURE=1, on a machine that does nothing else; the rest always."""

import http.client
import json
import math
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Tuple

import ridgecast as rc

PROGRAM, DOCKER = Path(sys.argv[1]), Path(sys.argv[2])
SERVERS, MEMBERS, CAMERAS = (int(os.environ.get(name, small)) for name, small in (("SERVERS", 2), ("MEMBERS", 16), ("CAMERAS", 2)))
PAUSE, OUTAGE = float(os.environ.get("PAUSE", 2)), float(os.environ.get("OUTAGE", 3))
ROUNDS = int(os.environ.get("ROUNDS", 4))
PATIENCE = 120.0  # only ends what hangs
MEASURES = "MEASURE" in os.environ
WORLD = "terrain=alpine&seed=1"
OWN_MOUNTS = "TESTS_OWN_MOUNTS"  # set where this process has mounts of its own
began = time.monotonic()


def elapsed() -> float:
    return time.monotonic() - began


def say(text: str) -> None:
    print(f"[{elapsed():6.1f} s] {text}", flush=True)


def free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


def until(so: Callable[[], bool], what: str, within: float = PATIENCE) -> float:
    """Waits; how many seconds that took."""
    start = time.monotonic()
    while not so():
        assert time.monotonic() < start + within, f"not within {within:.0f} s: {what}"
        time.sleep(0.01)
    return time.monotonic() - start


def get(port: int, path: str) -> Tuple[int, bytes]:
    """0: no answer."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    try:
        connection.request("GET", path)
        answer = connection.getresponse()
        return answer.status, answer.read()
    except (OSError, http.client.HTTPException):
        return 0, b""
    finally:
        connection.close()


class Program:
    """A process that is started, ended in any way, and started again with the same arguments; its output goes on in one file."""

    def __init__(self, name: str, folder: Path, command: List[str], environment: Optional[Dict[str, str]] = None) -> None:
        self.name, self._command, self._log = name, command, folder / f"{name}.log"
        self._environment = {**os.environ, **(environment or {})}
        self.process: Optional["subprocess.Popen[bytes]"] = None

    def start(self) -> None:
        with open(self._log, "ab") as out:
            self.process = subprocess.Popen(self._command, stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.STDOUT,
                                            env=self._environment)

    def runs(self) -> bool:
        return self.process is not None and self.process.poll() is None

    def send(self, number: int) -> None:
        assert self.process
        self.process.send_signal(number)

    def end(self, number: int = signal.SIGKILL) -> int:
        if not self.process:
            return 0
        if self.runs():
            self.send(signal.SIGCONT)
            self.send(number)
        return self.process.wait(PATIENCE)

    def last_words(self) -> str:
        return "\n".join(self._log.read_text(errors="replace").splitlines()[-5:]) if self._log.exists() else "not started"


class Place:
    """Redis, the servers and HAProxy, with the files that are shipped for them."""

    def __init__(self, stack: ExitStack, servers: int) -> None:
        self.folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="ridgecast-servers-")))
        ports = [free_port() for _ in range(servers + 2)]
        self.redis_port, self.port, self.server_ports = ports[0], ports[1], ports[2:]
        self.disk = self.folder / "redis"
        self.disk.mkdir()
        if OWN_MOUNTS in os.environ:  # a disk of its own, that can be filled
            subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64m", "none", str(self.disk)], check=True)
            stack.callback(lambda: subprocess.run(["umount", "--lazy", str(self.disk)], check=True))
        self.redis = Program("redis", self.folder, ["redis-server", str(DOCKER / "redis.conf"), "--port", str(self.redis_port), "--dir",
                                                    str(self.disk)])
        user = re.search(r"^user (\w+) on >(\S+)", (DOCKER / "redis.conf").read_text(), re.M)
        assert user
        self._user = user.groups()
        self.servers = [
            Program(f"server-{k}", self.folder,
                    [str(PROGRAM), "--port", str(port), "--terrain", "alpine", "--seed", "1", "--state", str(self.folder / f"state-{k}"),
                     "--shared", f"redis://{':'.join(self._user)}@127.0.0.1:{self.redis_port}", "--reconnect-url", "",
                     "--trusted-proxy", "127.0.0.0/8",
                     "--max-cameras", "1000", "--max-connections-per-address", "4000", "--session-idle", "600", "--drain", "5",
                     "--drain-delay", "3", "--log-level", "info"])
            for k, port in enumerate(self.server_ports)]
        configuration = self.folder / "haproxy.cfg"  # the one that is shipped, with a line for each further server
        configuration.write_text((DOCKER / "haproxy.cfg").read_text() +
                                 "".join(f"    server s{k} 127.0.0.1:{port}\n" for k, port in enumerate(self.server_ports) if k >= 2))
        self.balancer = Program("haproxy", self.folder, [shutil.which("haproxy") or "/usr/sbin/haproxy", "-db", "-f", str(configuration)], {
            "BIND": f"127.0.0.1:{self.port}", "ADMIN": str(self.folder / "admin"),
            "SERVER_A": f"127.0.0.1:{self.server_ports[0]}", "SERVER_B": f"127.0.0.1:{self.server_ports[min(1, servers - 1)]}"})
        for program in [self.redis, *self.servers, self.balancer]:
            stack.callback(program.end)

    @property
    def url(self) -> str:
        return f"ws://127.0.0.1:{self.port}"

    def answers(self, k: int) -> bool:
        return get(self.server_ports[k], "/readyz")[0] == 200

    def start(self, servers: Optional[int] = None) -> None:
        self.redis.start()
        until(self.redis_answers, "Redis answers")
        for k in range(len(self.servers) if servers is None else servers):
            self.serve(k)
        self.balancer.start()
        until(lambda: get(self.port, "/readyz")[0] == 200 or not self.balancer.runs(), "HAProxy answers")
        assert self.balancer.runs(), self.balancer.last_words()

    def serve(self, k: int) -> None:
        self.servers[k].start()
        until(lambda: self.answers(k) or not self.servers[k].runs(), "a server answers")
        assert self.servers[k].runs(), self.servers[k].last_words()

    def redis_answers(self) -> bool:
        try:
            with socket.create_connection(("127.0.0.1", self.redis_port), 1) as s:
                s.sendall(f"AUTH {' '.join(self._user)}\r\nPING\r\n".encode())
                answers = s.makefile()
                return [answers.readline(), answers.readline()] == ["+OK\n", "+PONG\n"]
        except OSError:
            return False

    def restart_redis(self) -> None:
        self.redis.start()
        until(self.redis_answers, f"Redis answers again; {self.redis.last_words()}")

    def last_words(self) -> str:
        return "\n".join(f"-- {program.name}\n{program.last_words()}" for program in [self.redis, self.balancer, *self.servers])


# ---- those who take part; each runs on a thread, and whatever it must not meet is in `wrong` ----

wrong: List[str] = []
over = threading.Event()


def thread(run: Callable[[], None], name: str) -> threading.Thread:
    def guarded() -> None:
        try:
            run()
        except Exception as e:  # what reaches this would have needed a person
            wrong.append(f"{name}: {type(e).__name__}: {e}")

    made = threading.Thread(target=guarded, name=name, daemon=True)
    made.start()
    return made


def late(what: str, seconds: float, limit: float) -> None:
    if MEASURES and seconds > limit:
        wrong.append(f"{what} for {seconds:.1f} s; {limit:.0f} s are allowed")


class Progress:
    """Counts events, and knows the longest pause between two."""

    def __init__(self) -> None:
        self.count, self._longest, self._last = 0, 0.0, elapsed()

    def event(self) -> None:
        now = elapsed()
        self._longest, self._last = max(self._longest, now - self._last), now
        self.count += 1

    def longest(self) -> float:
        """Since this was asked last, one that began before included."""
        longest, self._longest = max(self._longest, elapsed() - self._last), 0.0
        return longest


def again(run: Callable[[], Any], progress: Progress) -> None:
    """Until all is over; a call that was in vain is made again. One whose connection is lost for good makes no progress any more."""
    while not over.is_set():
        try:
            run()
            progress.event()
        except rc.Timeout:
            pass
        except rc.Lost:
            over.wait(0.1)


class Members:
    """They stand in rings of eight and move a little. A member's height says when it was placed, so its neighbours know how old it is."""

    RING, RATE = 8, 10.0

    def __init__(self, url: str, count: int) -> None:
        self.worlds = [rc.join(f"{url}?session=race&{WORLD}", name=f"member-{k}", sensor=True, timeout=PATIENCE) for k in range(count)]
        self.unseen_for = 0.0
        self.lost: Dict[int, str] = {}  # members whose connection is lost for good, and why
        self._seen: Dict[Tuple[int, int], float] = {}
        self._lock = threading.Lock()
        self._thread = thread(self._run, "members")

    def _place(self, k: int) -> None:
        ring, angle = k // self.RING, (k % self.RING) * 2 * math.pi / self.RING + 0.1 * elapsed()
        try:
            self.worlds[k].place(2000.0 * ring + 20 * math.cos(angle), 1000 + elapsed(), 20 * math.sin(angle))
            self.lost.pop(k, None)
        except rc.Lost as e:
            self.lost[k] = str(e)

    def _run(self) -> None:
        turn = 0
        due = elapsed()
        while not over.is_set():
            for k in range(len(self.worlds)):
                self._place(k)
                if k % self.RING == turn % 2:  # who is gone ages until the next look, so few look, and often
                    self._look(k)
            turn += 1
            due = max(due + 1 / self.RATE, elapsed())
            time.sleep(max(0.0, due - elapsed()))

    def _look(self, k: int) -> None:
        """Each neighbour's age, by the height that it had; one that is not there ages on."""
        ring = range(k // self.RING * self.RING, min((k // self.RING + 1) * self.RING, len(self.worlds)))
        ages = {m.name: m.position[1] - 1000 for m in self.worlds[k].members if m.position}
        now = elapsed()
        with self._lock:
            for other in ring:
                if other == k:
                    continue
                placed = ages.get(f"member-{other}", self._seen.get((k, other), now))
                placed = max(placed, self._seen.get((k, other), placed))
                self._seen[k, other] = placed
                self.unseen_for = max(self.unseen_for, now - placed)

    def forget(self) -> float:
        with self._lock:
            worst, self.unseen_for = self.unseen_for, 0.0
        return worst

    def unseen_now(self) -> float:
        now = elapsed()
        with self._lock:
            return max((now - placed for placed in self._seen.values()), default=0.0)


class Editor:
    """Makes edits one after another, each until it is acknowledged, with the key that it had first."""

    def __init__(self, url: str, lane: int) -> None:
        self.name, self._lane = f"editor-{lane}", lane
        self.world = rc.join(f"{url}?session=race&{WORLD}", name=self.name, sensor=True, timeout=PATIENCE)
        self.acknowledged: Dict[str, int] = {}  # number by place
        self.refusals: Counter[str] = Counter()
        self.progress = Progress()
        self._thread = thread(self._run, self.name)

    def _run(self) -> None:
        k = 0
        while not over.is_set():
            x, z = float(12 * (k % 80)), float(40 * self._lane + k // 80)
            kind = k % 4
            fields: Dict[str, Any] = {"x": x, "z": z}
            if kind == 0:
                op, fields = "crater", {**fields, "radius": 4, "depth": 1}
            elif kind == 1:
                op, fields = "smooth", {**fields, "radius": 5}
            elif kind == 2:
                op, fields = "raise", {**fields, "radius": 5, "by": 0.5}
            else:
                op, fields = "road", {"line": [[x, z], [x + 12, z + 3]], "width": 4}
            while not over.is_set():
                try:
                    self.acknowledged[place_of({"op": op, **fields})] = self.world.edit(op, key=f"{self.name}-{k}", timeout=5, **fields)
                    self.progress.event()
                    break
                except (rc.Timeout, rc.Refused, rc.Lost) as e:  # later, with the same key
                    self.refusals[str(e)[:120]] += 1
                    over.wait(0.2)
            k += 1
            over.wait(0.25)

    def wait(self) -> None:
        self._thread.join(PATIENCE)


def place_of(edit: Dict[str, Any]) -> str:
    """What tells an edit of these editors from all others."""
    x, z = edit["line"][0][:2] if "line" in edit else edit.get("at") or (edit["x"], edit["z"])
    return f"{edit['op']} {x:.2f} {z:.2f}"


class Camera:
    """Flies in a circle and waits for each pose's mesh, whose hash the library compares with the server's."""

    def __init__(self, url: str, k: int) -> None:
        self.world = rc.join(f"{url}?session=race&{WORLD}", name=f"camera-{k}", threshold=8, triangles=20000, timeout=PATIENCE)
        self._k = k
        self.progress = Progress()
        thread(lambda: again(self._fly, self.progress), f"camera-{k}")

    def _fly(self) -> None:
        angle = 0.05 * elapsed() + self._k
        self.world.camera(1000 + 300 * math.cos(angle), 1500, 300 * math.sin(angle), yaw=angle, pitch=-0.4)
        over.wait(0.1)


class Stepped:
    """A session whose clock is stepped by one member and followed by others, on any servers: all see the same times, none twice."""

    STEP = 0.05

    def __init__(self, url: str, followers: int) -> None:
        url = f"{url}?session=stepped&{WORLD}"
        self.owner = rc.join(url, clock="stepped", name="owner", sensor=True, timeout=PATIENCE)
        self.followers = [rc.join(url, name=f"follower-{k}", sensor=True, follow=True, timeout=PATIENCE) for k in range(followers)]
        self.times: List[List[float]] = [[] for _ in self.followers]
        self.progress = [Progress() for _ in range(1 + followers)]
        self.refusals: Counter[str] = Counter()
        self._owes = False
        thread(lambda: again(self._step, self.progress[0]), "owner")
        for k in range(followers):
            self._follow(k)

    def _follow(self, k: int) -> None:
        thread(lambda: again(lambda: self.times[k].append(self.followers[k].clock.next()), self.progress[1 + k]), f"follower-{k}")

    def _step(self) -> None:
        """A step of which it is unknown whether it was done is waited for."""
        owes, self._owes = self._owes, True
        try:
            self.owner.clock.step(0 if owes else self.STEP, timeout=5)
        except rc.Refused as e:
            self.refusals[str(e)[:120]] += 1
            over.wait(0.1)
        except rc.Lost:  # whether it was done nobody can wait for; the next one is another
            self._owes = False
            raise
        self._owes = False
        over.wait(0.02)

    def judge(self) -> None:
        for k, seen in enumerate(self.times):
            back = [(a, b) for a, b in zip(seen, seen[1:]) if b <= a]
            if back:
                wrong.append(f"follower-{k}: the stepped clock went back: {back[:3]}")
        for sentence, times in self.refusals.most_common(3):
            say(f"  {times} x {sentence}")


class Real:
    """A session whose clock goes by itself: two members agree on its time, and it never goes back."""

    def __init__(self, url: str) -> None:
        url = f"{url}?session=real&{WORLD}"
        self.worlds = [rc.join(url, name=f"watch-{k}", sensor=True, timeout=PATIENCE) for k in range(2)]
        self.apart = self.back = 0.0
        self._last = [0.0, 0.0]
        thread(self._run, "watch")

    def _run(self) -> None:
        while not over.is_set():
            for k, world in enumerate(self.worlds):
                try:
                    world.place(float(k), 1000, 0)
                except rc.Lost:
                    pass
            begin = time.monotonic()
            a, b = (world.clock.time for world in self.worlds)
            took = time.monotonic() - begin
            self.apart = max(self.apart, abs(a - b) - took - sum(world.clock.uncertainty for world in self.worlds))
            self.back = max([self.back] + [last - now for last, now in zip(self._last, (a, b))])
            self._last = [a, b]
            over.wait(0.1)

    def forget(self) -> Tuple[float, float]:
        out = self.apart, self.back
        self.apart = self.back = 0.0
        return out


def listed(port: int, session: str) -> Dict[str, List[int]]:
    """The numbers of a session's edits, as one server lists them, by place."""
    numbers: Dict[str, List[int]] = {}
    since = 0
    while True:
        status, body = get(port, f"/v1/sessions/{session}/edits?since={since}&limit=1000")
        if status == 503:  # it has just begun to read what the others made
            time.sleep(1)
            continue
        assert status == 200, (status, body[:200])
        page = json.loads(body)
        for edit in page["edits"]:
            assert edit["number"] == since + 1, f"{port}: edit {edit['number']} follows {since}"
            since = edit["number"]
            numbers.setdefault(place_of(edit["edit"]), []).append(since)
        if since == page["last"] or not page["edits"]:
            return numbers


def acceptance(place: Place) -> None:
    place.start()
    say(f"{SERVERS} servers, {MEMBERS} members, {CAMERAS} cameras")
    members = Members(place.url, MEMBERS)
    cameras = [Camera(place.url, k) for k in range(CAMERAS)]
    editors = [Editor(place.url, k) for k in range(max(2, MEMBERS // 25))]
    stepped, real = Stepped(place.url, 4), Real(place.url)
    say("all have joined")

    everyone = {f"camera-{k}": camera.progress for k, camera in enumerate(cameras)}
    everyone |= {editor.name: editor.progress for editor in editors}
    everyone |= {"owner" if k == 0 else f"follower-{k - 1}": progress for k, progress in enumerate(stepped.progress)}

    def count(*kinds: str) -> int:
        return sum(progress.count for name, progress in everyone.items() if name.startswith(kinds))

    def longest(*kinds: str) -> float:
        return max(progress.longest() for name, progress in everyone.items() if name.startswith(kinds))

    def phase(what: str, seconds: float, bus: bool = True) -> None:
        """Lets this time pass, and says what it was like. Judged: neighbours where Redis was there, meshes and clocks always."""
        kinds = ("editor", "camera", "owner")
        before = [count(kind) for kind in kinds]
        longest(*kinds)
        members.forget()
        real.forget()
        over.wait(seconds)
        unseen, (apart, back) = members.forget(), real.forget()
        edits, meshes, steps = (count(kind) - was for kind, was in zip(kinds, before))
        pauses = [longest(kind) for kind in kinds]
        say(f"{what}: unseen for {unseen:.1f} s, {edits} edits ({pauses[0]:.1f} s), {meshes} meshes ({pauses[1]:.1f} s), {steps} steps "
            f"({pauses[2]:.1f} s), clocks {1e3 * apart:.0f} ms apart, {1e3 * back:.0f} ms back")
        if bus:
            late(f"{what}: a member was unseen by a neighbour", unseen, 3)
        late(f"{what}: a camera waited for its mesh", pauses[1], 3)
        if apart > 0.1 or back > 0.1:
            wrong.append(f"{what}: the real clock was {apart:.3f} s apart or went back by {back:.3f} s")

    def recovered(what: str) -> None:
        """All go on by themselves."""
        before = {name: progress.count for name, progress in everyone.items()}

        def all_go_on() -> bool:
            go_on = all(progress.count > before[name] for name, progress in everyone.items())
            return go_on and members.unseen_now() < 3 and not members.lost

        try:
            took = until(all_go_on, what, 60)
            say(f"{what}: all go on after {took:.1f} s")
            late(f"{what}: not all went on", took, 3)
        except AssertionError:
            stuck = [name for name, progress in everyone.items() if progress.count == before[name]]
            wrong.append(f"{what}: after 60 s {stuck or 'none'} did not go on; a member is unseen for {members.unseen_now():.1f} s; "
                         f"lost: {list(members.lost.items())[:3]}")

    phase("calm", 2 * PAUSE)
    for number in (signal.SIGKILL, signal.SIGTERM):
        for k in range(SERVERS):
            what = f"server {k} {'killed' if number == signal.SIGKILL else 'stopped'}"
            ended = threading.Thread(target=lambda k=k, number=number: place.servers[k].end(number))
            ended.start()
            phase(what, PAUSE)
            ended.join(PATIENCE)
            recovered(what)
            place.serve(k)
            phase(f"server {k} is back", PAUSE)
    place.redis.end(signal.SIGKILL)
    phase("Redis killed", OUTAGE, bus=False)
    place.restart_redis()
    recovered("Redis is back")
    phase("calm", PAUSE)
    place.redis.send(signal.SIGSTOP)
    phase("Redis stopped", OUTAGE, bus=False)
    place.redis.send(signal.SIGCONT)
    recovered("Redis goes on")
    phase("calm", PAUSE)
    if OWN_MOUNTS in os.environ:
        filler = place.disk / "filler"
        with open(filler, "wb", buffering=0) as out:
            try:
                while out.write(bytes(4096)):
                    pass
            except OSError:
                pass
        phase("Redis' disk is full", OUTAGE, bus=False)
        filler.unlink()
        if not place.redis.runs():  # with appendfsync always it ends where it cannot write; whoever runs it starts it again
            place.restart_redis()
        recovered("Redis' disk has room")
    phase("calm", 2 * PAUSE)

    recovered("at the end")
    over.set()
    for editor in editors:
        editor.wait()
    worlds = members.worlds + [camera.world for camera in cameras] + [editor.world for editor in editors]
    hashes: List[int] = []

    def one_ground() -> bool:
        for world in worlds:
            world.place(0, 1000, 0)
        hashes[:] = [world.hash for world in worlds]
        return len(set(hashes)) == 1

    try:
        took = until(one_ground, "one ground", 60)
        say(f"one ground everywhere within {took:.1f} s")
        late("there was not one ground", took, 3)
    except AssertionError:
        wrong.append(f"{len(set(hashes))} grounds: {Counter(hashes).most_common(4)}")
    acknowledged = {what: number for editor in editors for what, number in editor.acknowledged.items()}
    lists = [listed(port, "race") for port in place.server_ports]
    for k, numbers in enumerate(lists):
        lost = [what for what, number in acknowledged.items() if number not in numbers.get(what, [])]
        twice = [what for what, made in numbers.items() if len(made) > 1]
        say(f"server {k}: {len(numbers)} edits, {len(acknowledged)} acknowledged, {len(lost)} lost, {len(twice)} twice")
        if lost or twice:
            wrong.append(f"server {k}: lost {lost[:3]}, twice {twice[:3]}")
        if numbers != lists[0]:
            wrong.append(f"server {k} lists other edits than server 0")
    stepped.judge()
    assert acknowledged
    refusals: Counter[str] = sum((editor.refusals for editor in editors), Counter())
    say(f"{len(acknowledged)} edits, {count('owner')} steps, {count('camera')} meshes, "
        f"{sum(world.reconnections for world in members.worlds)} reconnections of members")
    for sentence, times in refusals.most_common(8):
        say(f"  {times} x {sentence}")


def split(place: Place) -> None:
    """Ten sessions, each with a member that stays, while servers join and leave: whoever joins later meets it, on the same ground."""
    place.start(1)
    sessions = [f"{place.url}?session=world-{k}&terrain=alpine&seed={k}" for k in range(10)]
    stay = [rc.join(url, name="first", sensor=True, timeout=PATIENCE) for url in sessions]
    for k, world in enumerate(stay):
        world.edit("raise", x=5, z=5, radius=20, core=10, by=4 + k)
    running, splits, joined = {0}, 0, 0
    for turn in range(ROUNDS):
        away = [k for k in range(SERVERS) if k not in running]
        if away and (len(running) < 2 or turn % 2 == 0):
            what, running = f"server {away[0]} joins", running | {away[0]}
            place.serve(away[0])
        else:
            leaver = min(running)
            what, running = f"server {leaver} leaves", running - {leaver}
            place.servers[leaver].end(signal.SIGTERM if turn % 4 < 2 else signal.SIGKILL)
        until(lambda: get(place.port, "/readyz")[0] == 200, "HAProxy has a server")
        for k, url in enumerate(sessions):
            worlds = [rc.join(url, name=f"second-{n}", sensor=True, timeout=PATIENCE) for n in range(3)]
            joined += len(worlds)
            met: Counter[str] = Counter()

            def meet() -> bool:
                met.clear()
                for world in [stay[k], *worlds]:
                    world.place(0, 1000, 0)
                for world in worlds:
                    met["first"] += any(m.name == "first" for m in world.members) and world.hash == stay[k].hash
                return met["first"] == len(worlds)

            try:
                until(meet, "all meet", 20)
            except AssertionError:
                splits += 1
                grounds = [float(world.heights([(5.0, 5.0)])[0]) for world in [stay[k], *worlds]]
                wrong.append(f"{what}: world-{k} is split: {met['first']} of {len(worlds)} met the first; heights {grounds}")
            for world in worlds:
                world.close()
        say(f"{what}: {splits} of {(turn + 1) * len(sessions)} split, {joined} have joined")


def steps(place: Place) -> None:
    """What is read after a step is of that step, whichever servers they are on who read and who are read."""
    place.start()
    url = f"{place.url}?session=steps&{WORLD}"
    owner = rc.join(url, clock="stepped", name="owner", sensor=True, everybody=True, timeout=PATIENCE)
    followers = [rc.join(url, name=f"follower-{k}", sensor=True, follow=True, everybody=True, timeout=PATIENCE) for k in range(MEMBERS)]
    until(lambda: all(len(world.members) == MEMBERS for world in [owner, *followers]), "all see all")
    read: Counter[str] = Counter()

    def judge(world: rc.World, step: int) -> None:
        for other in world.members:
            if other.name == "owner":
                continue
            seen = int.from_bytes(other.state, "big")
            read["old" if seen < step else "of it" if seen == step else "of the next"] += 1

    def follow(world: rc.World) -> None:
        for step in range(1, 50 * ROUNDS + 1):
            world.clock.next(PATIENCE)
            judge(world, step - 1)
            world.place(0, 1000, 0, state=step.to_bytes(4, "big"))
        with suppress(rc.Error):  # says that it is done; no other comes
            world.clock.next(PATIENCE)

    for world in followers:
        thread(lambda world=world: follow(world), "follower")  # type: ignore[misc]
    for step in range(1, 50 * ROUNDS + 1):
        owner.clock.step(0.05, PATIENCE)
        judge(owner, step)
    say(f"{50 * ROUNDS} steps of {MEMBERS} members on {SERVERS} servers; read: {dict(read)}")
    if read["old"] or read["of it"] + read["of the next"] < 50 * ROUNDS * MEMBERS * MEMBERS:
        wrong.append(f"{read['old']} states that were read after a step were older")


def main() -> int:
    if not shutil.which("redis-server") or not (shutil.which("haproxy") or os.path.exists("/usr/sbin/haproxy")):
        print("SKIPPED: redis-server or haproxy is not installed: ./run install test")
        return 77
    if OWN_MOUNTS not in os.environ and subprocess.run(["unshare", "--mount", "true"], stderr=subprocess.DEVNULL).returncode == 0:
        os.execvpe("unshare", ["unshare", "--mount", sys.executable, *sys.argv], {**os.environ, OWN_MOUNTS: "1"})
    with ExitStack() as stack:
        place = Place(stack, SERVERS)
        try:
            {"acceptance": acceptance, "split": split, "steps": steps}[sys.argv[3] if len(sys.argv) > 3 else "acceptance"](place)
        except Exception as e:
            wrong.append(f"{type(e).__name__}: {e}")
        over.set()
        if wrong:
            print("\n".join(wrong), flush=True)
            print(place.last_words(), flush=True)
            if keep := os.environ.get("KEEP"):
                shutil.copytree(place.folder, keep, dirs_exist_ok=True, ignore=shutil.ignore_patterns("admin"))
    return 1 if wrong else 0


if __name__ == "__main__":
    status = main()
    sys.stdout.flush()
    os._exit(status)  # without waiting for threads in calls
