// The window's edit mode against a server that plays a script: where the brush lies on the mesh, what a click sends, what is said when
// there is no editing. (With a window and a real server: tests/e2e/window_edits_test.cpp.)
#include "client/viewer/editor.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <functional>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "common/codec/codec.h"
#include "common/edits/json.h"
#include "common/wire/wire.h"
#include "tests/support/leaf_meshes.h"
#include "tests/support/waiting.h"
#include "tests/unit/client/link/raw_world.h"

namespace ridgecast::viewer {
namespace {

using test::RawConnection;
using test::RawServer;
using testing_support::await;
using testing_support::kTimeout;

core::Url at(const RawServer& server, const std::string& token = "") {
  return {.host = "127.0.0.1", .port = server.port(), .session = "default", .token = token};
}

void greet(RawConnection& peer, std::uint32_t revision = wire::kRevision) {
  peer.upgrade();
  peer.readFrame();  // hello
  wire::World world = test::rawWorld();
  world.revision = revision;
  peer.sendFrame(wire::encode(wire::ServerMessage(world)));
}

// A ridge along z in the middle of a leaf of 256 m, 10^9 m out; steps.
constexpr lattice::LeafAddress kLeaf{3, 4'000'000, -3'900'000};
constexpr lattice::Step kRidge = 32'768;
double ridge(double x) { return 20'000 - std::abs(x - static_cast<double>(kLeaf.x() + kRidge)) / 4; }

void sendRidge(RawConnection& peer) {
  std::vector<mesh::LocalVertex> points;
  for (std::int32_t x = 0; x <= 65'536; x += 4096)
    for (std::int32_t z = 0; z <= 65'536; z += 4096) points.push_back({x, z, 20'000 - std::abs(x - static_cast<std::int32_t>(kRidge)) / 4});
  const mesh::LeafMesh leaf = support::sweep(kLeaf, points);
  wire::Iteration it;
  it.number = 1;
  it.meshHash = mesh::hashTerm(leaf.address, mesh::hashLeaf(leaf));
  it.whole.push_back({leaf.address, static_cast<std::uint32_t>(leaf.vertices.size()), static_cast<std::uint32_t>(leaf.triangles.size()),
                      codec::encodeLeaf(leaf)});
  peer.sendFrame(wire::encode(wire::ServerMessage(it)));
}

// The next edit that the client sends; nothing when it has gone.
std::optional<wire::Edit> readEdit(RawConnection& peer) {
  for (;;) {
    const std::string frame = peer.readFrame();
    if (frame.empty()) return std::nullopt;
    const auto message = wire::decodeClient({reinterpret_cast<const std::uint8_t*>(frame.data()), frame.size()});
    if (const auto* edit = message ? std::get_if<wire::Edit>(&*message) : nullptr) return *edit;
  }
}

camera::Camera looking(double yaw, double pitch) {
  camera::Camera camera;
  camera.pose.x = kLeaf.x() + kRidge + std::llround(6000 * std::sin(yaw));
  camera.pose.z = kLeaf.z() + kRidge + std::llround(6000 * std::cos(yaw));
  camera.pose.remainderX = 0.75;
  camera.pose.remainderZ = 0.25;
  camera.pose.y = 110;
  camera.pose.yaw = yaw;
  camera.pose.pitch = pitch;
  camera.projection.width = 640;
  camera.projection.height = 360;
  return camera;
}

// From the camera, metres.
camera::Vec3 seenAt(const camera::Camera& camera, const Spot& spot) {
  const camera::Vec3 d = towards(camera, spot.x, spot.y);
  return {d.x * spot.depth, d.y * spot.depth, d.z * spot.depth};
}

TEST(Editor, TheOutlineLiesOnTheMeshAroundWhereAClickMakesTheEdit) {
  std::vector<wire::Edit> edits;
  RawServer server([&](RawConnection& peer) {
    greet(peer);
    sendRidge(peer);
    while (const auto edit = readEdit(peer)) {
      edits.push_back(*edit);
      peer.sendFrame(wire::encode(wire::ServerMessage(wire::EditAnswer{edit->id, edits.size()})));
    }
  });
  auto client = link::Client::open(at(server), {}).value();
  ASSERT_TRUE(client->receive(kTimeout));
  ViewerState state;
  auto editor = std::make_unique<Editor>(*client, at(server), state);
  editor->click(looking(0, -0.5), {0.5, 0.5});
  editor->update(looking(0, -0.5), {}, 1);
  EXPECT_TRUE(state.edit.lines.empty()) << "it has not begun";
  editor->toggle();
  ASSERT_TRUE(state.edit.on);
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> any(-1, 1);
  std::vector<std::function<void(const edits::Crater&)>> checks;
  for (int k = 0; k < 40; ++k) {
    const camera::Camera camera = looking(3 * any(random), -0.7 + 0.1 * any(random));
    const Editor::Pointer pointer{0.5 + 0.15 * any(random), 0.5 + 0.15 * any(random)};
    editor->update(camera, pointer, 1);
    ASSERT_GT(state.edit.lines.size(), 60u);
    editor->click(camera, pointer);
    checks.emplace_back([camera, pointer, lines = state.edit.lines](const edits::Crater& crater) {
      const auto steps = [&](const camera::Vec3& v) {  // from the crater's middle
        return std::pair(v.x * 256 + static_cast<double>(camera.pose.x - crater.at.x) + camera.pose.remainderX,
                         v.z * 256 + static_cast<double>(camera.pose.z - crater.at.z) + camera.pose.remainderZ);
      };
      for (const Segment& line : lines) {
        const camera::Vec3 v = seenAt(camera, line.first);
        const auto [x, z] = steps(v);
        EXPECT_NEAR(std::hypot(x, z), 8 * 256, 1.5);
        EXPECT_NEAR((v.y + camera.pose.y) * 256, ridge(x + static_cast<double>(crater.at.x)), 1);
      }
      const camera::Vec3 middle{
          (static_cast<double>(crater.at.x - camera.pose.x) - camera.pose.remainderX) / 256,
          ridge(static_cast<double>(crater.at.x)) / 256 - camera.pose.y,
          (static_cast<double>(crater.at.z - camera.pose.z) - camera.pose.remainderZ) / 256,
      };
      const auto spot = spotOf(camera, middle);
      ASSERT_TRUE(spot);
      EXPECT_NEAR(spot->x * 640, pointer.first * 640, 0.3) << "pixels";
      EXPECT_NEAR(spot->y * 360, pointer.second * 360, 0.3);
    });
    const std::string made = "Edit " + std::to_string(checks.size()) + " made.";
    ASSERT_TRUE(await([&] { return editor->update(camera, pointer, 1), state.hint == made; })) << state.hint;
  }
  // The sky is no ground; the brush ends with the mode.
  editor->update(looking(0, 1), {}, 1);
  EXPECT_TRUE(state.edit.lines.empty());
  editor->click(looking(0, 1), {0.5, 0.5});
  EXPECT_EQ(state.hint, "There is no ground.");
  editor->toggle();
  EXPECT_FALSE(state.edit.on);
  client.reset();
  ASSERT_EQ(edits.size(), checks.size());
  for (std::size_t k = 0; k < checks.size(); ++k) checks[k](std::get<edits::Crater>(edits::fromJson(edits[k].operation).value().what));
}

TEST(Editor, ARoadIsDrawnFromItsCornersToTheBrush) {
  RawServer server([](RawConnection& peer) {
    greet(peer);
    sendRidge(peer);
    readEdit(peer);
  });
  auto client = link::Client::open(at(server), {}).value();
  ASSERT_TRUE(client->receive(kTimeout));
  ViewerState state;
  Editor editor(*client, at(server), state);
  editor.toggle();
  const camera::Camera camera = looking(0, -0.5);
  EditRequests road;
  road.tool = core::Tool::kRoad;
  editor.grant(road, camera);
  EXPECT_EQ(state.edit.tool, core::Tool::kRoad);
  const auto draw = [&](double x, double y) {
    editor.update(camera, Editor::Pointer{x, y}, 1);
    return state.edit.lines.size();
  };
  const std::size_t outline = draw(0.4, 0.6);
  EXPECT_FALSE(state.edit.mayUndo);
  editor.click(camera, {0.4, 0.6});
  EXPECT_TRUE(state.edit.mayUndo);
  EXPECT_GT(draw(0.7, 0.55), outline + 3);
  // Its first piece begins where was clicked, its last ends at the mouse.
  EXPECT_NEAR(state.edit.lines[outline].first.x, 0.4, 1e-3);
  EXPECT_NEAR(state.edit.lines[outline].first.y, 0.6, 1e-3);
  EXPECT_NEAR(state.edit.lines.back().second.x, 0.7, 1e-3);
  EXPECT_NEAR(state.edit.lines.back().second.y, 0.55, 1e-3);
  editor.undo();
  EXPECT_EQ(draw(0.7, 0.55), outline);
  client.reset();
}

TEST(Editor, SaysWhyThereIsNoEditing) {
  for (const std::uint32_t revision : {3u, 4u}) {
    RawServer server([revision](RawConnection& peer) {
      greet(peer, revision);
      if (revision == 3) peer.drain();
    });
    auto client = link::Client::open(at(server), {}).value();
    ViewerState state;
    Editor editor(*client, at(server), state);
    EXPECT_TRUE(revision == 3 || await([&] { return client->receive(std::chrono::milliseconds(1)), client->connection().error(); }));
    editor.toggle();
    EXPECT_FALSE(state.edit.on);
    EXPECT_EQ(state.hint, revision == 3 ? "This server is too old for edits of the ground."
                                        : "Without a connection to a server, the ground cannot be edited.");
    client.reset();
  }
}

TEST(Editor, WhoShowsATokenIsToldWhetherItMayEdit) {
  for (const bool may : {false, true}) {
    std::string head;
    RawServer stream([](RawConnection& peer) {
      greet(peer);
      peer.drain();
    });
    RawServer http([&](RawConnection& peer) {
      head = peer.readHead();
      peer.send(may ? "HTTP/1.1 422 No\r\nContent-Length: 3\r\n\r\nno\n" : "HTTP/1.1 403 No\r\nContent-Length: 9\r\n\r\nNo right\n");
      peer.drain();
    });
    auto client = link::Client::open(at(stream), {}).value();
    ViewerState state;
    Editor editor(*client, at(http, "secret"), state);
    editor.toggle();
    EXPECT_FALSE(state.edit.on);
    EXPECT_TRUE(await([&] { return editor.update({}, {}, 1), may ? state.edit.on : state.hint == "No right"; })) << state.hint;
    EXPECT_EQ(state.edit.on, may);
    EXPECT_TRUE(head.starts_with("DELETE /v1/sessions/default/edits/0 HTTP/1.1\r\n")) << head;
    EXPECT_NE(head.find("Authorization: Bearer secret\r\n"), std::string::npos);
    client.reset();
  }
}

TEST(Brush, ThroughAPlaceOfTheWindowOneSeesWhatIsShownThere) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> any(-1, 1);
  for (int k = 0; k < 1000; ++k) {
    camera::Camera camera;
    camera.pose.yaw = 3 * any(random);
    camera.pose.pitch = 1.5 * any(random);
    camera.projection.width = 640;
    camera.projection.height = 360;
    const double x = 0.5 + 0.5 * any(random), y = 0.5 + 0.5 * any(random), metres = 100 * (2 + any(random));
    const camera::Vec3 d = towards(camera, x, y);
    const auto spot = spotOf(camera, {d.x * metres, d.y * metres, d.z * metres});
    ASSERT_TRUE(spot);
    EXPECT_NEAR(spot->x, x, 1e-9);
    EXPECT_NEAR(spot->y, y, 1e-9);
  }
}

}  // namespace
}  // namespace ridgecast::viewer
