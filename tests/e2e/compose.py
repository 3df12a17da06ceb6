"""Starts what docker/compose.scale.yaml says as processes in a network of their own, where its names have addresses; then uses it as people
would: a client flies, an edit made on one server is in the other's ground, a server is drained, all end by their signal.
    compose.py SOURCE CLIENT SERVER|ROOT      ROOT: a folder with the image's files, in which its program runs as its user
Grafana is not started, since Debian has none; its files are judged by what they name."""

import http.client
import json
import os
import re
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, Callable, Dict, List, Tuple

import yaml

SOURCE, CLIENT, SERVER = (Path(argument).resolve() for argument in sys.argv[1:4])
DOCKER, PATHS = SOURCE / "docker", SOURCE / "client/evaluation/paths"
PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
PATIENCE = 60.0  # only ends what hangs
OWN_NETWORK = "TESTS_OWN_NETWORK"  # set where this process has a network and mounts of its own
PROGRAMS = {"redis": "redis-server", "haproxy": "haproxy", "prom/prometheus": "prometheus"}  # by image; each takes what its image's does
MISSING = ["grafana/grafana"]


def say(text: str) -> None:
    print(text, flush=True)


def until(so: Callable[[], bool], what: str) -> None:
    end = time.monotonic() + PATIENCE
    while not so():
        assert time.monotonic() < end, f"not within {PATIENCE:.0f} s: {what}"
        time.sleep(0.05)


def ask(name: str, port: int, path: str, body: str = "") -> Tuple[int, str]:
    """0: no answer."""
    connection = http.client.HTTPConnection(ADDRESSES[name], port, timeout=10)
    try:
        connection.request("POST" if body else "GET", path, body or None, {"Content-Type": "application/json"} if body else {})
        answer = connection.getresponse()
        return answer.status, answer.read().decode()
    except (OSError, http.client.HTTPException):
        return 0, ""
    finally:
        connection.close()


compose: Dict[str, Any] = yaml.safe_load((DOCKER / "compose.scale.yaml").read_text())
services: Dict[str, Dict[str, Any]] = compose["services"]
ADDRESSES = {name: f"127.0.1.{k + 1}" for k, name in enumerate(services)}
NAMES = "127.0.1.254"


def answer_names() -> None:
    """DNS, as a container engine answers it: A records of the services, and nothing else."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind((NAMES, 53))
        while True:
            query, sender = s.recvfrom(512)
            labels, at = [], 12
            while query[at]:
                labels.append(query[at + 1 : at + 1 + query[at]].decode())
                at += 1 + query[at]
            question = query[12 : at + 5]
            address = ADDRESSES.get(labels[0]) if struct.unpack(">H", question[-4:-2]) == (1,) and len(labels) == 1 else None
            record = b"\xc0\x0c" + struct.pack(">HHIH", 1, 1, 1, 4) + socket.inet_aton(address) if address else b""
            flags = 0x8580 if address or labels[0] in ADDRESSES else 0x8583
            s.sendto(query[:2] + struct.pack(">HHHHH", flags, 1, bool(record), 0, 0) + question + record, sender)


class Container:
    """A service as a process: with its environment, its volumes and its files, at the address of its name."""

    def __init__(self, name: str, folder: Path) -> None:
        self.name, service = name, services[name]
        address = ADDRESSES[name]
        self.grace = float(str(service.get("stop_grace_period", "10s")).rstrip("s"))
        self._log = folder / f"{name}.log"
        paths: Dict[str, Path] = {}  # those of the container, and what lies there
        for volume in service.get("volumes", []):
            source, *rest = volume.split(":")
            if source.startswith("."):
                paths[rest[0]] = (DOCKER / source).resolve()
                assert paths[rest[0]].exists(), f"{name}: there is no {source}"
            else:
                target = rest[0] if rest else source
                assert not rest or source in compose["volumes"], f"{name}: volume {source} is not declared"
                paths[target] = folder / name / target.strip("/")
                paths[target].mkdir(parents=True)
        image = service["image"].split(":")[0]
        environment = {key: str(value) for key, value in service.get("environment", {}).items()}
        if image == "ridgecast-server":
            # As the Dockerfile says, but for one address of several in one network.
            environment = {**image_environment(), **environment, "RIDGECAST_HOST": address, "RIDGECAST_TRUSTED_PROXY": "127.0.0.0/8"}
            if SERVER.is_dir():
                paths["/tmp"] = folder / name / "tmp"
                paths["/tmp"].mkdir(parents=True)
                for path in paths.values():
                    os.chown(path, 65534, 65534)
                binds = f"mount --rbind {SERVER} {SERVER} && mount -o remount,bind,ro {SERVER} && "  # read_only
                binds += "".join(f"mount --bind {source} {SERVER}{target} && " for target, source in paths.items())
                command = ["unshare", "--mount", "sh", "-c", binds + 'exec "$@"', "sh", "chroot", "--userspec=65534:65534", str(SERVER),
                           "/usr/local/bin/ridgecast-server"]
            else:
                environment = {key: str(paths.get(value, value)) for key, value in environment.items()}
                environment["XDG_CACHE_HOME"] = str(folder)
                command = [str(SERVER)]
        else:
            program = PROGRAMS[image]
            given = [str(paths.get(word, word)) for word in service.get("command", [])]
            command = {
                "redis-server": [address if word == "0.0.0.0" else word for word in given] + ["--dir", str(paths.get("/data", folder))],
                "haproxy": ["haproxy", "-db", "-f", str(paths.get("/usr/local/etc/haproxy/haproxy.cfg"))],
                "prometheus": ["prometheus", f"--config.file={paths.get('/etc/prometheus/prometheus.yml')}",
                               f"--storage.tsdb.path={folder / name}", f"--web.listen-address={address}:9090"],
            }[program]
            if "BIND" in environment:
                environment = {**environment, "BIND": address + environment["BIND"], "ADMIN": str(folder / "admin")}
        with open(self._log, "wb") as out:
            self.process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.STDOUT, start_new_session=True,
                                            env={"PATH": PATH, **environment})

    def end(self) -> None:
        begin = time.monotonic()
        self.process.send_signal(signal.SIGTERM)
        code = self.process.wait(PATIENCE)
        took = time.monotonic() - begin
        assert took < self.grace, f"{self.name} took {took:.1f} s of the {self.grace:.0f} s that it is given to end"
        assert code in (0, 128 + signal.SIGTERM, -signal.SIGTERM), f"{self.name} ended with {code}"

    def last_words(self) -> str:
        return f"-- {self.name}\n" + "\n".join(self._log.read_text(errors="replace").splitlines()[-8:])


def image_environment() -> Dict[str, str]:
    stage = (DOCKER / "Dockerfile").read_text().split("\nFROM ")[-1]
    return dict(re.findall(r"^ENV (\w+)=(.*)$", stage, re.M))


def figures(query: str) -> List[float]:
    """What Prometheus says now."""
    status, body = ask("prometheus", 9090, f"/api/v1/query?query={query}")
    return [float(result["value"][1]) for result in json.loads(body)["data"]["result"]] if status == 200 else []


def depth(name: str) -> int:
    return 1 + max((depth(other) for other in services[name].get("depends_on", [])), default=0)


def use(running: Dict[str, Container]) -> None:
    servers = [name for name in running if name.startswith("server-")]
    for name in servers:
        until(lambda: ask(name, 7070, "/readyz")[0] == 200 or running[name].process.poll() is not None, f"{name} is ready")
    until(lambda: ask("balancer", 7070, "/readyz")[0] == 200, "the balancer has a server")
    say(f"{', '.join(running)} run")

    status, body = ask(servers[0], 7070, "/v1/sessions/default/edits", '{"op": "crater", "x": 0, "z": 0, "radius": 12, "depth": 4}')
    assert (status, json.loads(body)) == (201, {"number": 1}), (status, body)
    heights = "/v1/heights?at=0,0"
    until(lambda: all('"op": "crater"' in re.sub(r'":\s*', '": ', ask(name, 7070, "/v1/sessions/default/edits")[1]) for name in servers),
          "every server has the edit")
    assert len({ask(name, 7070, heights)[1] for name in servers}) == 1
    say("an edit made on one server is in the other's ground")

    def fly() -> None:
        with tempfile.TemporaryDirectory() as out:
            flown = subprocess.run([str(CLIENT), "fly", f"ws://{ADDRESSES['balancer']}:7070", "--path", str(PATHS / "alpine.json"),
                                    "--seconds", "2", "--threshold", "8", "--size", "160x90", "--frames-every", "2", "--out", out],
                                   stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=10 * PATIENCE)
            assert flown.returncode == 0, flown.stdout

    fly()
    say("a client flies")
    until(lambda: figures('up{job="ridgecast"}') == [1.0] * len(servers), "Prometheus reads every server")
    until(lambda: sum(figures("ridgecast_delivery_seconds_count")) > 0, "it has seen the flight")
    say("Prometheus reads every server")

    running[servers[0]].process.send_signal(signal.SIGUSR1)
    until(lambda: ask(servers[0], 7070, "/readyz")[0] == 503, "a server drains")
    fly()
    for _ in range(20):
        assert ask("balancer", 7070, "/readyz")[0] == 200
        assert ask("balancer", 7070, heights)[0] == 200
    say("a drained server's work goes to the other")
    for name in reversed(list(running)):
        running[name].end()
    say("all ended by their signal, in time")


def judge_grafana() -> None:
    """What its files name is there."""
    provisioning = DOCKER / "grafana/provisioning"
    for source in yaml.safe_load((provisioning / "datasources/prometheus.yaml").read_text())["datasources"]:
        assert source["url"] == "http://prometheus:9090", source
    mounted = dict(volume.split(":")[:2][::-1] for volume in services["dashboard"]["volumes"])
    for provider in yaml.safe_load((provisioning / "dashboards/ridgecast.yaml").read_text())["providers"]:
        assert (DOCKER / mounted[provider["options"]["path"]]).is_dir(), provider
    home = Path(services["dashboard"]["environment"]["GF_DASHBOARDS_DEFAULT_HOME_DASHBOARD_PATH"])
    json.loads((DOCKER / mounted[str(home.parent)] / home.name).read_text())


def main() -> int:
    missing = [program for program in [*PROGRAMS.values(), "unshare", "ip"] if not shutil.which(program, path=PATH)]
    if missing:
        print(f"SKIPPED: {', '.join(missing)}: ./run install test")
        return 77
    if OWN_NETWORK not in os.environ:
        if subprocess.run(["unshare", "--net", "--mount", "true"], stderr=subprocess.DEVNULL).returncode:
            print("SKIPPED: this user may not have a network of his own")
            return 77
        os.execvpe("unshare", ["unshare", "--net", "--mount", sys.executable, *sys.argv], {**os.environ, OWN_NETWORK: "1"})
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    threading.Thread(target=answer_names, daemon=True).start()
    running: Dict[str, Container] = {}
    with tempfile.TemporaryDirectory(prefix="ridgecast-compose-") as name:
        folder = Path(name)
        folder.chmod(0o711)
        (folder / "resolv.conf").write_text(f"nameserver {NAMES}\n")
        for root in ["", *([str(SERVER)] if SERVER.is_dir() else [])]:
            subprocess.run(["mount", "--bind", str(folder / "resolv.conf"), f"{root}/etc/resolv.conf"], check=True)
        try:
            judge_grafana()
            for name in sorted(services, key=depth):
                if services[name]["image"].split(":")[0] not in MISSING:
                    running[name] = Container(name, folder)
            use(running)
        except Exception as e:
            print(f"{type(e).__name__}: {e}", flush=True)
            print("\n".join(container.last_words() for container in running.values()), flush=True)
            return 1
        finally:
            for container in running.values():
                if container.process.poll() is None:
                    os.killpg(container.process.pid, signal.SIGKILL)
                    container.process.wait()
    print("1 passed, 0 failed")
    return 0


if __name__ == "__main__":
    sys.exit(main())
