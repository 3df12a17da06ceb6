#!/usr/bin/env python3
"""Runs seeds of the simulation, a process a core, and shortens the events of those that fail:  simulate.py PROGRAM FIRST COUNT

Ends with "N passed, N failed"."""
import os
import queue
import re
import subprocess
import sys
import threading
import time

CHUNK = 25  # seeds a process
LONGEST = 3600  # seconds without another seed: it hangs. One takes 11 s of a processor that 20 others may want
LAST_WORDS = 20  # lines
SHORTENED = 3  # of the seeds that fail; each takes minutes


class Total:
    def __init__(self, count: int) -> None:
        self.lock, self.began, self.said = threading.Lock(), time.monotonic(), time.monotonic()
        self.count, self.done, self.session, self.processor = count, 0, 0.0, 0.0
        self.failed: list[int] = []

    def line(self) -> str:
        rate = self.session / self.processor if self.processor else 0
        return (f"[{time.monotonic() - self.began:4.0f} s] {self.done} of {self.count} seeds, {len(self.failed)} failed; {self.session / 3600:.2f} h of "
                f"session time, {rate:.0f} h an hour of processor time")

    def add(self, seeds: int, output: str) -> None:
        with self.lock:
            self.done += seeds
            spent = re.search(r"([\d.]+) s of session time in ([\d.]+) s of processor time", output)
            if spent:
                self.session += float(spent[1])
                self.processor += float(spent[2])
            if time.monotonic() - self.said > 10:
                self.said = time.monotonic()
                print(self.line(), flush=True)

    def fail(self, seed: int, code: int, words: list[str]) -> None:
        with self.lock:
            self.failed.append(seed)
            print("".join(words) + f"SEED={seed} failed: " + (f"exit code {code}" if code >= 0 else f"ended by signal {-code}"), flush=True)


def run(program: str, first: int, last: int, total: Total) -> None:
    """A process ends with the first seed that fails, and the next one goes on behind it."""
    while first <= last:
        which = {"SEED": str(first)} if total.count == 1 else {"FROM": str(first), "SEEDS": str(last - first + 1)}
        env = {**os.environ, **which, "SHORTEN": "0"}
        with subprocess.Popen([program], env=env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
            timer = threading.Timer(LONGEST, process.kill)
            timer.start()
            lines, seed = [], first
            for line in process.stdout:
                lines.append(line)
                if line.startswith("SEED="):
                    seed = int(line[5:])
                    timer.cancel()
                    timer = threading.Timer(LONGEST, process.kill)
                    timer.start()
            timer.cancel()
        if process.returncode == 0:
            seed = last
        else:
            total.fail(seed, process.returncode, lines[-LAST_WORDS:])
        total.add(seed - first + 1, "".join(lines))
        first = seed + 1


def main() -> int:
    program, first, count = os.path.abspath(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    last, total = first + count - 1, Total(count)
    chunks: queue.SimpleQueue[int] = queue.SimpleQueue()
    for begin in range(first, last + 1, CHUNK):
        chunks.put(begin)

    def work() -> None:
        while True:
            try:
                begin = chunks.get_nowait()
            except queue.Empty:
                return
            run(program, begin, min(begin + CHUNK - 1, last), total)

    threads = [threading.Thread(target=work) for _ in range(os.cpu_count() or 1)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    print(total.line())
    for seed in sorted(total.failed)[:SHORTENED]:
        print(f"Shortening the events of SEED={seed}", flush=True)
        subprocess.run([program, "--gtest_brief=1"], cwd=os.path.dirname(program),
                       env={**os.environ, "SEED": str(seed), "SHORTEN": "1"}, check=False)
    if total.failed:
        print("Failed: " + " ".join(f"SEED={seed}" for seed in sorted(total.failed)))
    print(f"{count - len(total.failed)} passed, {len(total.failed)} failed")
    return 1 if total.failed else 0


if __name__ == "__main__":
    sys.exit(main())
