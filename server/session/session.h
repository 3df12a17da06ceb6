#pragma once
// One world and its members.
//
// A Session is a terrain with its seed and parameters, seen by several cameras. Its world never changes while it lives (a successor may
// take its name: server/directory); its ground changes only by edits (edits.h). Every camera has its own mesh, replica and pool
// (server/member).

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "common/outcome/outcome.h"
#include "common/terrain/terrain.h"
#include "server/clock/session_clock.h"
#include "server/editing/edit_pages.h"
#include "server/editing/edits.h"
#include "server/presence/presence.h"
#include "server/recording/events.h"
#include "server/session/budgets.h"
#include "server/session/camera_quota.h"
#include "server/session/live_cameras.h"
#include "server/session/resources.h"
#include "server/session/world_spec.h"

namespace ridgecast::session {

// A camera's right to be in its session, and what it may use there. It leaves with the last copy.
struct Membership {
  std::shared_ptr<CameraQuota::Share> quota;  // of the server's
  std::shared_ptr<const void> slot;           // of the session's
  std::shared_ptr<Budgets> budgets;
  std::string client;  // as http::Request::client; empty: nobody knows
};

// Immutable except for its members, their clock and their edits; any thread.
class Session {
 public:
  Session(std::string name, std::shared_ptr<const terrain::Terrain> terrain, WorldSpec spec, std::shared_ptr<const Resources> resources,
          std::shared_ptr<CameraQuota> quota, editing::Edits::Kept kept = {});

  const std::string& name() const { return name_; }
  editing::Ground ground() const { return edits_->ground(); }
  std::shared_ptr<const terrain::Terrain> terrain() const { return ground().terrain; }  // of ground()
  editing::Edits& edits() const { return *edits_; }
  editing::EditPages& editPages() const { return *editPages_; }
  // Asks for the edit, charged to these budgets. `done` as Edits::Done. Before the first: claimBeforeEdits().
  void edit(editing::Edit edit, const std::shared_ptr<Budgets>& budgets, std::function<void(const editing::Edits::Answer& number)> done);
  // Calls this before an edit is made, until it succeeds; edits wait for it, at most kMaxClaiming. Set before anybody has the session.
  using Claim = std::function<void(std::function<void(Outcome<void>)> done)>;
  static constexpr std::uint32_t kMaxClaiming = 64;
  void claimBeforeEdits(Claim claim) { claim_ = std::move(claim); }
  // Its edits and its clock are those of all servers, or they cannot be reached: somebody who was on another server may come.
  bool isCurrent() const { return edits_->isCurrent() && clock_->isCurrent(); }
  const WorldSpec& spec() const { return spec_; }
  std::uint64_t contentHash() const { return contentHash_; }  // of the world, whatever its edits
  // Of world and edits: another for other ground. Equal on all servers with the same ground.
  std::uint64_t hashOf(const editing::Ground& ground) const;
  const Resources& resources() const { return *resources_; }
  std::uint32_t members() const { return *members_ & ~kEnded; }  // on this server
  // Members on other servers, which count for Limits::maxMembers.
  void setMembersElsewhere(std::uint32_t members) { membersElsewhere_ = members; }
  std::uint32_t membersElsewhere() const { return membersElsewhere_; }
  presence::Presence& presence() const { return *presence_; }
  clock::SessionClock& clock() const { return *clock_; }
  LiveCameras& live() const { return *live_; }
  recording::Observer* observer() const { return observer_.get(); }  // null: it is not recorded
  // Tells the observer, of what happens now.
  void note(recording::Event event) const {
    if (observer_) observer_->note(resources_->timer->now(), std::move(event));
  }

  // `client`: whose budgets the camera shares. Error: the session or the server is full, or the session has just ended.
  Outcome<Membership> enter(const std::string& client = {});
  // What this client's cameras and queries share (BudgetsByClient::of).
  std::shared_ptr<Budgets> budgetsOf(const std::string& client) const { return resources_->budgets->of(client, resources_->timer->now()); }
  // Ends it if it has no members; then nobody can enter or edit.
  bool end();
  // It was ended, or has a successor: a client that enters now must connect again, and nobody can edit.
  void retire();
  bool isRetired() const { return isRetired_; }
  // A member has said hello, or a client that is no member uses it: an idle session that is used does not end.
  void use() { ++uses_; }
  std::uint64_t uses() const { return uses_; }

 private:
  static constexpr std::uint32_t kEnded = 1u << 31;  // flag in members_, whose count is then 0
  std::string name_;
  WorldSpec spec_;
  std::atomic<std::uint64_t> uses_{0};
  std::atomic<bool> isRetired_{false};
  std::uint64_t contentHash_;
  const std::uint64_t nonce_;  // without identities: the next session of this name may give its edits the same numbers
  std::shared_ptr<const Resources> resources_;
  std::shared_ptr<std::atomic<std::uint32_t>> members_;
  std::atomic<std::uint32_t> membersElsewhere_{0};
  std::shared_ptr<CameraQuota> quota_;
  std::shared_ptr<recording::Observer> observer_;
  std::shared_ptr<clock::SessionClock> clock_;
  std::shared_ptr<presence::Presence> presence_;
  std::shared_ptr<LiveCameras> live_ = std::make_shared<LiveCameras>();
  std::shared_ptr<editing::Edits> edits_;
  std::shared_ptr<editing::EditPages> editPages_;
  Claim claim_;  // empty: none is needed
  struct Claiming {
    std::atomic<bool> isDone{false};
    std::atomic<std::uint32_t> waiting{0};
  };
  const std::shared_ptr<Claiming> claiming_ = std::make_shared<Claiming>();
};

}  // namespace ridgecast::session
