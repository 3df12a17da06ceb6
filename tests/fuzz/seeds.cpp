// Writes seed corpora below a folder, one for each fuzzer: FOLDER/client, FOLDER/server, ...
#include <png.h>
#include <tiffio.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <tuple>
#include <vector>

#include "common/codec/codec.h"
#include "common/edits/json.h"
#include "common/edits/packed.h"
#include "common/mesh/leaf_mesh.h"
#include "common/points/points.h"
#include "common/terrain/raster.h"
#include "common/wire/wire.h"
#include "server/access/jwt.h"
#include "server/access/tokens.h"
#include "server/recording/format.h"
#include "tests/support/leaf_meshes.h"
#include "tests/support/recorded_events.h"

namespace {

using namespace ridgecast;

std::filesystem::path root;
int written = 0;

void write(const std::string& fuzzer, const std::string& bytes) {
  std::filesystem::create_directories(root / fuzzer);
  std::ofstream(root / fuzzer / ("seed-" + std::to_string(++written)), std::ios::binary) << bytes;
}

// Messages as the fuzzers read them: two bytes of length before each.
template <class Message>
std::string framed(const std::vector<Message>& messages) {
  std::string out;
  for (const Message& m : messages) {
    const std::string bytes = wire::encode(m);
    out += static_cast<char>(bytes.size() & 255);
    out += static_cast<char>(bytes.size() >> 8);
    out += bytes;
  }
  return out;
}

wire::LeafWhole wholeOf(const mesh::LeafMesh& leaf) {
  return {leaf.address, static_cast<std::uint32_t>(leaf.vertices.size()), static_cast<std::uint32_t>(leaf.triangles.size()),
          codec::encodeLeaf(leaf)};
}

// Points that raise one vertex of a leaf, remove another and insert three.
std::vector<std::uint8_t> pointsOver(const mesh::LeafMesh& leaf) {
  const auto isInside = [&](const mesh::LocalVertex& v) { return leaf.address.contains({leaf.address.x() + v.x, leaf.address.z() + v.z}); };
  const auto count = static_cast<std::uint32_t>(std::ranges::count_if(leaf.vertices, isInside));
  const int unit = 1 << lattice::horizontalBits(leaf.address.level);
  std::vector<points::Change> changes{{leaf.address, {}, {}, {{unit, unit}, {unit, 5 * unit}, {9 * unit, 2 * unit}}}};
  if (count > 2) changes[0].removed = {0}, changes[0].raised = {1};
  std::vector<std::uint8_t> payload;
  points::Writer writer(payload);
  writer.changes(
      {{&leaf.address, 1}, {}, {}}, [&](const lattice::LeafAddress&) { return count; }, changes);
  if (count > 2) writer.raised(leaf.address.level, 0, 300);
  for (int k = 0; k < 3; ++k) writer.inserted(leaf.address.level, 0, true, 256 * k);
  writer.finish();
  return payload;
}

void clientSeeds() {
  wire::Hello hello;
  hello.clientName = "seed";
  hello.settings = {wire::Metric::kPixels, 1, 100'000, 64'000, 900};
  wire::PoseMessage pose{1, {}};
  pose.camera.pose = {.x = -5, .z = 1 << 20, .remainderX = 0, .remainderZ = 0, .y = 100, .yaw = 1, .pitch = -0.2};
  wire::PoseMessage second = pose;
  second.sequence = 2;
  second.state = {7, 0, 255};
  using M = wire::ClientMessage;
  const wire::Resume resume{{{{0, 1, 2}, 3}, {{1, 2, -2}, 9}}, {}, 0};
  for (const M& m :
       {M(hello), M(pose), M(wire::Acknowledge{1, 7}), M(wire::ResendLeaves{{{0, 0, 0}, {3, -4, 5}}}), M(wire::ResendLeaves{}), M(resume)})
    write("client", framed<M>({m}));
  hello.role = wire::Role::kSensor;
  hello.members = hello.clock = hello.errors = true;
  const wire::Query heights{1, wire::QueryKind::kHeights, {5, -6}, {7, 1 << 20}, 0, {}},
      normals{2, wire::QueryKind::kNormals, {5}, {7}, 32, {}}, rays{3, wire::QueryKind::kRays, {}, {}, 0, {{1, 2, 3, 0, -1, 0.5, 100}}},
      materials{4, wire::QueryKind::kMaterials, {5}, {7}, 0, {}};
  for (const M& m : {M(hello), M(wire::AskClock{9}), M(wire::SetClock{true, wire::ClockMode::kScaled, 2}), M(wire::ClockStep{20'000, true}),
                     M(wire::StepDone{1}), M(wire::PassOver{8}), M(heights), M(normals), M(rays), M(materials),
                     M(wire::AskGround{4, {5, 6}, 20, 0.5}), M(wire::ChangeSettings{{wire::Metric::kArea, 2, 50'000, 0}})})
    write("client", framed<M>({m}));
  write("client", framed<M>({hello, pose, wire::Edit{1, "key", R"({"op":"crater","x":0,"z":0,"radius":5,"depth":1})"}}));
  write("client", framed<M>({hello, resume, pose, wire::Acknowledge{1, 0}, second, wire::ResendLeaves{}, wire::Acknowledge{2, 5}}));
}

// As conversation.cpp reads them: terms, hello, the world; then poses, each with its iteration, acknowledgement and time.
void conversationSeeds() {
  for (const char pacing : {40, 41, 42, 0, 1}) {
    std::string bytes{3, pacing, 2, 4};
    for (char k = 0; k < 20; ++k) bytes += {0, 2, static_cast<char>(4 + 16 * (k % 8)), k, static_cast<char>(5 * k), 6, 13 + 16 * 7};
    write("conversation", bytes);
    write("conversation", bytes.insert(2, {10, 26, 12, 13}));  // resumes, changes settings
  }
}

void serverSeeds() {
  support::Random random(3);
  using M = wire::ServerMessage;
  wire::World world;
  world.serverName = "seed";
  world.session = "default";
  world.terrainName = "alpine";
  world.terrainSource = "// source";
  world.horizon = 32'000;
  world.window = 4;
  write("server", framed<M>({world}));
  write("server", framed<M>({wire::ErrorMessage{wire::ErrorCode::kLimit, "too much"}}));
  const wire::Moved moved{7, {1, {}, {1, 2}}, 5};
  write("server", framed<M>({wire::Members{{{7, wire::Role::kSensor, "seed", moved}, {8, wire::Role::kViewer, "", {}}},
                                           {moved},
                                           {9},
                                           12,
                                           {10},
                                           wire::Crowd{1, {-1, 5}, {0, 7}, {3, 9}}}}));
  write("server", framed<M>({wire::Clock{wire::ClockMode::kStepped, 0, 5, 7, 1, {7, 8}, 2, "seed"}}));
  write("server", framed<M>({wire::EditAnswer{1, 2, ""},
                             wire::Edited{{{3, "address 1.2.3.4", "ann", R"({"edit":2,"op":"undo"})", {-256, 0, 256, 512}}}}}));
  write("server",
        framed<M>({wire::FoundEdits{3, {{-256, 0, 256, 512}}, {{1, -2}}}, wire::Squares{3, {{{1, -2}, {0x30, 2, 0, 9}, {0x30}}}}}));
  write("server", framed<M>({wire::Answer{1, {1.5f}, {0, 1, 0}, {-1, 2}}}));
  write("server", framed<M>({wire::Ground{1, 0.5, {wholeOf(support::terrainLike(random, 2, 1))}}}));
  for (int n : {1, 2, 5}) {
    const lattice::LeafAddress parent{1, 3, -2};
    mesh::LeafMesh first = support::terrainLike(random, n, 1);
    first.address = parent;
    const mesh::LeafMesh* source = &first;
    first = mesh::gather(parent, {&source, 1});
    wire::Iteration a, b, c, d;
    a.number = 1, b.number = 2, c.number = 3, d.number = 4;
    a.whole = {wholeOf(first), wholeOf({.address = {0, 0, 0}, .vertices = {}, .triangles = {}})};
    a.points = c.points = d.points = {0x30};
    b.points = pointsOver(first);
    c.gone = {parent};
    for (int q = 0; q < 4; ++q) c.come.push_back(parent.child(q));
    d.gone = c.come;
    d.come = {parent};
    write("server", framed<M>({a}));
    b.candidates = {{{{1 << 20, -5, 300}, 2.5f}, {{1 << 20, 700, -300}, 0.25f}}};
    write("server", framed<M>({a, b}));
    write("server", framed<M>({a, b, c, d}));
  }
}

void payloadSeeds() {
  // The bases of payload.cpp, in its order.
  support::Random random(1);
  std::vector<mesh::LeafMesh> bases{{.address = {2, 1, 1}, .vertices = {}, .triangles = {}}};
  for (int n : {1, 2, 4, 8}) bases.push_back(support::terrainLike(random, n, n % 3));
  bases.push_back(support::torn(random, support::terrainLike(random, 6, 1), 0.4));
  bases.push_back(support::randomTin(random, 30));
  for (std::size_t k = 0; k < bases.size(); ++k) {
    const mesh::LeafMesh& leaf = bases[k];
    const auto whole = codec::encodeLeaf(leaf);
    if (leaf.vertices.size() < 256 && leaf.triangles.size() < 256)
      write("payload", std::string{0, static_cast<char>(leaf.vertices.size()), static_cast<char>(leaf.triangles.size())} +
                           std::string(whole.begin(), whole.end()));
    const auto points = pointsOver(leaf);
    for (const char how : {0, 5, 9})
      write("payload",
            std::string{static_cast<char>(2 * k + 1), how, static_cast<char>(points.size())} + std::string(points.begin(), points.end()));
  }
}

std::string contents(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

void rasterSeeds() {
  constexpr std::uint32_t kWidth = 20, kHeight = 17;
  std::array<std::uint16_t, kWidth * kHeight> samples;
  for (std::size_t k = 0; k < samples.size(); ++k) samples[k] = static_cast<std::uint16_t>(1000 + 37 * (k % 11));
  const std::string raw(reinterpret_cast<const char*>(samples.data()), sizeof samples);
  for (const char* edit :
       {R"({"op":"raise","x":1,"z":-2,"radius":5,"core":2,"by":1.5})", R"({"op":"lower","x":1e9,"z":0,"radius":3,"by":1})",
        R"({"op":"crater","x":0,"z":0,"radius":12,"depth":4,"material":"gravel"})",
        R"({"op":"level","x":0,"z":0,"radius":20,"height":110,"slope":0.5})", R"({"op":"level","polygon":[[0,0],[9,0],[4,8]],"height":99})",
        R"({"op":"smooth","x":0,"z":0,"radius":8,"passes":4})", R"({"op":"road","line":[[0,0],[30,8]],"width":3,"grade":0.1})",
        R"({"op":"road","line":[[0,0,100],[30,8,104]],"width":3})", R"({"op":"stamp","x":0,"z":0,"columns":2,"samples":[0,0.5,1,-1]})",
        R"({"op":"smooth","at":[3,4],"radius":8})", R"({"op":"undo","edit":1})"}) {
    write("edit", edit);
    write("edit", edits::pack(edits::fromJson(edit).value()));
  }
  write("edit", R"({"op":"crater","crs":"lonlat","at":[6.5,49.25],"radius":12,"depth":4})");
  write("edit", R"({"op":"level","crs":"lonlat","polygon":[[6,49],[6.001,49],[6,49.001]],"height":99})");
  write("raster", '\3' + raw.substr(0, 2 * 17 * 17));
  write("raster", '\23' + raw.substr(0, 12));
  write("raster", " ncols 3\nnrows 2\nxllcorner 500\nyllcorner 7000\ncellsize 10\nnodata_value -1\n1.5 2 3\n4 -1 6e0\n");
  write("raster", " NCOLS 2\nNROWS 2\nXLLCENTER 11\nYLLCENTER 47\nCELLSIZE 0.000833\n1 2 3 4");
  write("raster", '!' + raw.substr(0, 2 * 11 * 11));  // .hgt
  const std::string file = (root / "made").string();
  std::vector<std::uint16_t> pixels(samples.begin(), samples.end());
  pixels.resize(3 * samples.size());
  for (const bool isPicture : {false, true})
    for (const bool tiled : {false, true})
      for (const std::uint16_t compression : {COMPRESSION_NONE, COMPRESSION_ADOBE_DEFLATE, COMPRESSION_LZW}) {
        const std::uint16_t bands = isPicture ? 3 : 1;
        TIFF* out = TIFFOpen(file.c_str(), "w");
        TIFFSetField(out, TIFFTAG_IMAGEWIDTH, kWidth);
        TIFFSetField(out, TIFFTAG_IMAGELENGTH, kHeight);
        TIFFSetField(out, TIFFTAG_BITSPERSAMPLE, 16);
        TIFFSetField(out, TIFFTAG_SAMPLESPERPIXEL, bands);
        TIFFSetField(out, TIFFTAG_PHOTOMETRIC, isPicture ? PHOTOMETRIC_RGB : PHOTOMETRIC_MINISBLACK);
        TIFFSetField(out, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
        TIFFSetField(out, TIFFTAG_COMPRESSION, compression);
        if (tiled) {
          TIFFSetField(out, TIFFTAG_TILEWIDTH, 16);
          TIFFSetField(out, TIFFTAG_TILELENGTH, 16);
          for (std::uint32_t j = 0; j < kHeight; j += 16)
            for (std::uint32_t i = 0; i < kWidth; i += 16) TIFFWriteTile(out, pixels.data(), i, j, 0, 0);
        } else {
          TIFFSetField(out, TIFFTAG_ROWSPERSTRIP, 4);
          for (std::uint32_t j = 0; j < kHeight; ++j) TIFFWriteScanline(out, pixels.data() + j * kWidth * bands, j, 0);
        }
        TIFFClose(out);
        write("raster", (isPicture ? '@' : '\0') + contents(file));
      }
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = kWidth, image.height = kHeight, image.format = PNG_FORMAT_LINEAR_Y;
  png_image_write_to_file(&image, file.c_str(), 0, samples.data(), 0, nullptr);
  write("raster", '\1' + contents(file));
  std::filesystem::remove(file);
}

void textSeeds() {
  for (const char* file : {"common/terrain/tutorial/dunes.glsl", "tests/bench/terrain/terraces.glsl", "common/terrain/alpine.glsl"})
    write("terrain", contents(std::filesystem::path(RIDGECAST_SOURCES) / file));
  for (const char* file : {"alpine", "canyon", "archipelago"})
    write("path", contents(std::filesystem::path(RIDGECAST_SOURCES) / "client/evaluation/paths" / (std::string(file) + ".json")));
  for (const char* target :
       {"/v1/heights?at=1,2&at=3,4", "/v1/normals?at=1e3,-2&spacing=2", "/v1/rays?ray=0,900,0,0,-1,0&reach=500", "/v1/sessions", "/metrics",
        "/v1/stream?session=a&terrain=canyon&seed=3", "/v1/sessions/default/snapshot.glb?x=0&z=0&altitude=120&yaw=30&threshold=2",
        "/v1/sessions/default/snapshot.json?x0=0&z0=0&x1=8&z1=8&error=5&compression=draco",
        "/v1/sessions/default/snapshot.tif?box=0,0,8,8&spacing=0.5",
        "/v1/sessions/default/snapshot.glb?box=6,49,7,50&crs=EPSG:2169&error=5", "/v1/rays?crs=lonlat&ray=6,49,900,0,1,-1",
        "/a?box=all&zoom=9&layer=colours&at=11.5,47", "ws://127.0.0.1:7070?session=race&seed=2"})
    write("request", "GET\n" + std::string(target) +
                         "\nlocalhost:7070\nhttp://localhost:7070\nBearer abc\nridgecast.v1, bearer.abc\n192.0.2.1, 2001:db8::1");
  for (const auto& [target, type, body] :
       {std::tuple{"/v1/normals", "application/json", std::string(R"({"at": [[1, 2.5], [-3e4, 0]], "spacing": 2})")},
        {"/v1/rays", "application/json", R"({"rays": [[0, 900, 0, 0, -1, 0]], "reach": 500})"},
        {"/v1/heights", "application/octet-stream", std::string(32, '\1')},
        {"/v1/rays?reach=500", "application/octet-stream", std::string(48, '?')}})
    write("request", std::string("POST\n") + target + "\nlocalhost:7070\n\n\n\n\n" + type + "\n" + body);
  const access::Time now(std::chrono::seconds(1'700'000'000));
  const access::Grant grant{"lab", access::Rights::all(), "harbour", now + std::chrono::hours(1)};
  write("token", "# a comment\n" + access::makeToken(grant).line + "\n" + access::makeToken({"guest", access::Right::kView, "", {}}).line);
  const std::string token = access::issueJwt(grant, std::string(32, 's'), now);
  write("token", token);
  write("token", token.substr(0, token.rfind('.')));
  write("settings", "# a comment\nport = 7070\nrate = 2.5\nquiet = true\nparam = [\"a=1\", \"b=2\"]\n");
  terrain::Tile tile{};
  const auto flat = terrain::encodeTile(tile);
  write("tile", {flat.begin(), flat.end()});
  for (std::size_t k = 0; k < tile.size(); ++k) tile[k] = static_cast<std::int32_t>((k * 2654435761u) >> (k % 29));
  const auto rough = terrain::encodeTile(tile);
  write("tile", {rough.begin(), rough.end()});
}

void recordingSeeds() {
  for (const std::size_t count : {3, 30, 300}) {
    recording::Encoder encoder;
    recording::Bytes block;
    for (const recording::Record& r : testing_support::recordedEvents(count, count)) encoder.put(r, block);
    const recording::Bytes frame = recording::compress(block);
    write("recording", '\0' + std::string(block.begin(), block.end()));
    write("recording", '\1' + std::string(frame.begin(), frame.end()));
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: fuzz_seeds FOLDER\n");
    return 2;
  }
  root = argv[1];
  clientSeeds();
  conversationSeeds();
  serverSeeds();
  payloadSeeds();
  rasterSeeds();
  textSeeds();
  recordingSeeds();
  std::printf("%d seeds in %s\n", written, argv[1]);
  return 0;
}
