#pragma once
// The stream's messages <-> bytes: one message a WebSocket frame, protobuf as in proto/ridgecast/v1/stream.proto. Decoding
// checks every field; an error names the message and field and says what would be right, and nothing of the input is used then. Counts of
// repeated fields are checked before anything is allocated for them. Pure functions; any thread.

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "common/outcome/outcome.h"
#include "common/wire/messages.h"

namespace ridgecast::wire {

// Limits of protocol version 1; PROTOCOL.md states the same numbers.
inline constexpr std::size_t kMaxClientMessageBytes = std::size_t{128} << 10;
inline constexpr std::size_t kMaxServerMessageBytes = std::size_t{256} << 20;
inline constexpr std::size_t kMaxNameBytes = 128;    // client, server and terrain names; no control characters
inline constexpr std::size_t kMaxSessionBytes = 64;  // letters, digits, '.', '_', '-'
inline constexpr std::size_t kMaxStateBytes = 256;   // of a pose
inline constexpr std::size_t kMaxTerrainSourceBytes = std::size_t{1} << 20;
inline constexpr std::size_t kMaxErrorBytes = 4096;
inline constexpr std::size_t kMaxResendLeaves = 4096;  // more: name none, which asks for all
inline constexpr std::size_t kMaxResumeLeaves = 2048;  // a message
inline constexpr std::size_t kMaxResumed = 65'536;     // in all
inline constexpr std::size_t kMaxResumeKeyBytes = 16;
inline constexpr std::size_t kMaxTiles = 64;                          // of one WantTiles or HeightTiles
inline constexpr std::size_t kMaxWantedTiles = 256;                   // that are not answered yet
inline constexpr std::size_t kMaxShadeBytes = std::size_t{16} << 20;  // of one leaf
inline constexpr std::size_t kMaxIterationLeaves = 65'536;            // of `gone`, of `whole` and of `changed`, each
inline constexpr std::uint32_t kMaxLeafTriangles = 1u << 20;
inline constexpr std::size_t kMaxPayloadBytes = std::size_t{64} << 20;
inline constexpr std::uint32_t kMaxWindow = 64;
inline constexpr double kMaxThreshold = 1e12;
inline constexpr double kMaxHorizon = 1e7;          // metres
inline constexpr std::size_t kMaxMembers = 65'536;  // of each list of a Members, and of Clock.waits_for
inline constexpr int kCellBits = 16;                // a crowd's least cells have sides of 2^16 steps, 256 m
inline constexpr std::size_t kMaxCells = 4096;      // of a Crowd
inline constexpr std::uint32_t kMaxCrowdLevel = 40;
inline constexpr std::size_t kMaxSmallMessageBytes = std::size_t{16} << 20;   // of Members, Clock and Answer
inline constexpr std::size_t kMaxCandidatesBytes = kMaxCandidates * 19 + 64;  // three varints of at most 5 bytes and a float each
inline constexpr std::int64_t kMaxCandidateReach = std::int64_t{1} << 27;     // steps from Candidates.x, .z
inline constexpr double kMaxErrorPixels = 1e9;                                // of a candidate
inline constexpr std::uint64_t kMaxStepTime = 3'600'000'000;                  // microseconds
inline constexpr std::uint64_t kMaxTime = std::uint64_t{1} << 53;
inline constexpr std::size_t kMaxPlaces = 8192;       // of a query
inline constexpr std::size_t kMaxRays = 256;          // of a query
inline constexpr std::size_t kMaxQueries = 64;        // of one client that are not answered
inline constexpr std::size_t kMaxGrounds = 4;         // the same
inline constexpr std::uint32_t kMaxSpacing = 65'536;  // steps
inline constexpr std::size_t kMaxEditKeyBytes = 64;
inline constexpr std::size_t kMaxEdits = 64;           // of one client that are not answered
inline constexpr std::size_t kMaxMadeEdits = 256;      // of an Edited
inline constexpr std::size_t kMaxSquares = 64;         // of one WantSquares or Squares
inline constexpr std::size_t kMaxWantedSquares = 256;  // that are not answered yet
inline constexpr std::size_t kMaxFinds = 4;            // of one client that are not answered
inline constexpr std::size_t kMaxFoundSquares = 4096;  // of a FoundEdits
inline constexpr std::size_t kMaxFoundAreas = 64;      // of a FoundEdits
inline constexpr double kMaxReach = 1e5;               // metres

// Whether a session's name can be one: 1..kMaxSessionBytes of [A-Za-z0-9._-].
bool sessionNameIsValid(std::string_view name);

// Encoding does not check values (the peer refuses those out of range); only an error's text and URL are cut to kMaxErrorBytes.
std::string encode(const ClientMessage& message);
std::string encode(const ServerMessage& message);

// The bytes of a Members alone. Those of several, one after the other, are a Members that has the entries of all, so that bytes made once
// are sent to many.
std::string encodePart(const Members& part);
std::string encodeMembers(std::string_view parts);  // the ServerMessage

// The field that is out of range, in the sentence of decodeClient; empty: none.
std::string refusalOf(const Ray& ray);
std::string refusalOf(const AskGround& ask);

// A query whose rays are out of range is no error: its `refusal` says so, and the connection lives.
// A hello of another protocol version is no error: it is returned with its version and name alone, so that it can be answered.
Outcome<ClientMessage> decodeClient(std::span<const std::uint8_t> bytes);
// The same for a world of another protocol version. A message of a kind that is not known is an UnknownKind.
Outcome<ServerMessage> decodeServer(std::span<const std::uint8_t> bytes);

}  // namespace ridgecast::wire
