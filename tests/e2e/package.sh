#!/usr/bin/env bash
# Installs what was built, builds the example against it with find_package alone, and lets it fly at an installed server.
#   package.sh BUILD SOURCE COMPILER_FLAGS [deb]
# With deb the packages that cpack makes are unpacked instead of cmake --install.
set -euo pipefail
build=$1 source=$2 flags=$3 deb=${4:-}
scratch=$(mktemp -d)
server=
trap '[[ -z $server ]] || kill "$server" 2>/dev/null || true; rm -rf "$scratch"' EXIT

if [[ $deb == deb ]]; then
  (cd "$build" && cpack -G DEB -B "$scratch/packages" >"$scratch/cpack.log" 2>&1) || { cat "$scratch/cpack.log" >&2; exit 1; }
  for package in "$scratch"/packages/*.deb; do
    dpkg-deb --info "$package" | grep -E '^ (Package|Version|Depends):'
    dpkg-deb -x "$package" "$scratch/root"
    [[ $package != *ridgecast_* ]] || dpkg-deb -e "$package" "$scratch/control"
  done
  prefix=$scratch/root/usr
else
  cmake --install "$build" --prefix "$scratch/root" >/dev/null
  prefix=$scratch/root
fi

mapfile -t guides < <(find "$prefix" -name '*.md')
"$source/tests/links.sh" "${guides[@]}"

# The examples know nothing but the prefix, and have a header with the name of one of ours; a plugin links the library too.
cp -r "$source/client/example" "$scratch/example"
mkdir -p "$scratch/example/common/camera"
echo '#error "the library includes a header of the program"' >"$scratch/example/common/camera/camera.h"
cat >>"$scratch/example/CMakeLists.txt" <<'TEXT'
include_directories(BEFORE ${CMAKE_CURRENT_SOURCE_DIR})
add_library(plugin MODULE example.cpp)
target_link_libraries(plugin PRIVATE Ridgecast::client -Wl,--no-undefined)
TEXT
cmake -S "$scratch/example" -B "$scratch/out" -DCMAKE_PREFIX_PATH="$prefix" -DCMAKE_CXX_FLAGS="$flags" >"$scratch/configure.log" 2>&1 ||
  { cat "$scratch/configure.log" >&2; exit 1; }
cmake --build "$scratch/out" 2>&1 | tail -n 40
! ldd "$scratch/out/example" | grep -E 'libGL|libEGL|libglfw|libepoxy' || { echo "the example needs OpenGL" >&2; exit 1; }

# A program in C needs a C compiler alone, by CMake and by pkg-config.
mkdir "$scratch/c"
cp "$source/client/example/heights.c" "$scratch/c"
cat >"$scratch/c/CMakeLists.txt" <<'TEXT'
cmake_minimum_required(VERSION 3.25)
project(InC LANGUAGES C)
foreach(package Boost OpenSSL draco nlohmann_json TIFF PNG Threads)
  set(CMAKE_DISABLE_FIND_PACKAGE_${package} ON)
endforeach()
find_package(Ridgecast REQUIRED COMPONENTS c)
add_executable(heights heights.c)
target_link_libraries(heights PRIVATE Ridgecast::c)
TEXT
cmake -S "$scratch/c" -B "$scratch/c/out" -DCMAKE_PREFIX_PATH="$prefix" >"$scratch/configure.log" 2>&1 || { cat "$scratch/configure.log" >&2; exit 1; }
cmake --build "$scratch/c/out" >"$scratch/build.log" 2>&1 || { cat "$scratch/build.log" >&2; exit 1; }
pc=$(dirname "$(find "$prefix" -name ridgecast.pc)")
# shellcheck disable=SC2046
PKG_CONFIG_PATH=$pc cc "$scratch/c/heights.c" -o "$scratch/c/by-pkg-config" $(PKG_CONFIG_PATH=$pc pkg-config --cflags --libs ridgecast)
libraries=$(dirname "$(find "$prefix/lib" -name libridgecast.so.1)")
[[ $(LD_LIBRARY_PATH=$libraries "$scratch/c/out/heights") == "$(LD_LIBRARY_PATH=$libraries "$scratch/c/by-pkg-config")" ]]

[[ $(LD_LIBRARY_PATH=$(dirname "$(find "$prefix/lib" -name libridgecast.so.1)") "$scratch/out/heights" | grep -c ' m$') -eq 3 ]]
for program in ridgecast-server ridgecast-client; do
  said=$("$prefix/bin/$program" --version)
  echo "$said"
  [[ $said =~ ^$program\ [0-9]+\.[0-9]+\.[0-9]+,\ protocol\ [0-9]+,\ commit\ ([0-9a-f]{12}\+?|unknown)$ ]] || { echo "that is no version" >&2; exit 1; }
done
"$prefix/bin/ridgecast-server" --port 0 --port-file "$scratch/port" >"$scratch/server.log" 2>&1 &
server=$!
for ((k = 0; k < 1200; ++k)); do
  [[ ! -s $scratch/port ]] || break
  sleep 0.1
done
[[ -s $scratch/port ]] || { cat "$scratch/server.log" >&2; exit 1; }
url=127.0.0.1:$(<"$scratch/port")
"$scratch/out/example" "ws://$url" | tee "$scratch/flight"
[[ $(grep -c 'ground' "$scratch/flight") -eq 20 ]]
# Another world, made by its URL; the README's line for heights.
"$scratch/out/example" "ws://$url?session=race&terrain=canyon&seed=7" >/dev/null
node -e '
  const [url] = process.argv.slice(1);
  const get = async (path) => { const r = await fetch("http://" + url + path); if (!r.ok) throw Error(await r.text()); return r.json(); };
  (async () => {
    const sessions = (await get("/v1/sessions")).sessions;
    if (!sessions.some((s) => s.name === "race" && s.terrain === "canyon" && s.seed === 7)) throw Error("the session is not listed");
    const heights = (await get("/v1/heights?at=2000,1500&at=2001,1500")).heights;
    if (heights.length !== 2 || !heights.every(Number.isFinite)) throw Error("no heights");
  })().catch((e) => { console.error(e.message); process.exit(1); });
' "$url"
if [[ $deb == deb && $EUID -eq 0 ]] && command -v systemd-sysusers setpriv >/dev/null; then
  # As installed: the package makes a user and a settings file; the server starts as that user with its own secrets.
  mkdir -p "$scratch/root/etc"
  DPKG_ROOT=$scratch/root sh "$scratch/control/postinst" configure
  IFS=: read -r _ _ uid gid _ < <(grep '^ridgecast:' "$scratch/root/etc/passwd")
  settings=$scratch/root/etc/ridgecast/server.toml
  echo "# the operator's" >>"$settings"
  DPKG_ROOT=$scratch/root sh "$scratch/control/postinst" configure
  grep -q "the operator's" "$settings" || { echo "an update replaces the settings" >&2; exit 1; }
  "$prefix/bin/ridgecast-server" token --token-file "$scratch/tokens" --out "$scratch/token"
  chown "$uid:$gid" "$scratch/tokens"
  [[ $(stat -c %a "$scratch/tokens" "$scratch/token") == $'600\n600' ]]
  chmod 755 "$scratch"
  mkdir -m 700 "$scratch/run" && chown "$uid:$gid" "$scratch/run"
  setpriv --reuid "$uid" --regid "$gid" --clear-groups "$prefix/bin/ridgecast-server" --config "$settings" --token-file "$scratch/tokens" \
    --state "$scratch/run/state" --port 0 --port-file "$scratch/run/port" >"$scratch/unit.log" 2>&1 &  # the unit's is systemd's to make
  unit=$!
  for ((k = 0; k < 1200; ++k)); do
    [[ ! -s $scratch/run/port ]] || break
    sleep 0.1
  done
  [[ -s $scratch/run/port ]] || { cat "$scratch/unit.log" >&2; exit 1; }
  kill "$unit" && wait "$unit"
fi
for guide in README.md server/README.md client/evaluation/README.md common/terrain/{README.md,prelude.glsl,tutorial/dunes.glsl}; do
  [[ -s $prefix/share/doc/ridgecast/$guide ]] || { echo "$guide is missing" >&2; exit 1; }
done
documents=$(find "$prefix/share/doc" -name copyright | wc -l)
[[ $documents -ge 2 && -s $prefix/share/doc/ridgecast/THIRD_PARTY.md && -d $prefix/share/doc/ridgecast/licences ]] || { echo "licences are missing" >&2; exit 1; }
echo "installed, built, flown"
