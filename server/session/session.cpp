#include "server/session/session.h"

#include <algorithm>
#include <iterator>
#include <random>
#include <variant>

#include "common/edits/author.h"
#include "common/edits/packed.h"
#include "common/lattice/lattice.h"
#include "common/outcome/contract.h"
#include "common/wire/wire.h"
#include "server/editing/measured_store.h"
#include "server/logging/logging.h"

namespace ridgecast::session {

namespace {

bool raise(std::atomic<std::uint32_t>& counter, std::uint32_t limit) {
  std::uint32_t now = counter;
  while (now < limit)
    if (counter.compare_exchange_weak(now, now + 1)) return true;
  return false;
}

std::uint64_t anyNumber() {
  std::random_device device;
  return std::uint64_t{device()} << 32 | device();
}

void count(metrics::Metrics& figures, const editing::Edits::Answer& number) {
  if (number) return figures.editsMade.Increment();
  const auto why = static_cast<std::size_t>(number.why);
  figures.editRefusals[std::min(why, figures.editRefusals.size() - 1)]->Increment();
}

constexpr std::size_t kMaxPast = 16u << 20;  // bytes of edits with which a recording begins

// Null: nobody records, or the ground cannot be told.
std::shared_ptr<recording::Observer> beginRecording(const Resources& resources, const std::string& name, const WorldSpec& spec,
                                                    const terrain::Terrain& terrain, std::uint64_t contentHash,
                                                    const editing::Edits::Kept& kept) {
  if (!resources.record) return nullptr;
  const auto refuse = [&](const std::string& why) {
    logging::warning({.session = name}, "is not recorded: " + why);
    return nullptr;
  };
  std::vector<recording::Edited> past;
  if (kept.store && kept.store->compacted() > 0) return refuse("edits of its ground were compacted, and cannot be repeated");
  for (std::size_t bytes = 0; kept.store && past.size() < kept.store->last();) {
    auto edits = kept.store->read(past.size(), 1u << 20);
    if (!edits) return refuse(edits.error().message);
    for (editing::Applied& e : *edits) {
      past.push_back({e.number, std::move(e.author), std::move(e.operation)});
      bytes += past.back().operation.size();
    }
    if (bytes > kMaxPast) return refuse("its ground has more than " + std::to_string(kMaxPast >> 20) + " MiB of edits");
  }
  recording::World world{
      name, spec.terrain, spec.seed, spec.parameters, contentHash, static_cast<bool>(terrain.colours()), resources.serverName};
  return resources.record(std::move(world), std::move(past), resources.timer->now());
}

// A recording's edits are its own.
editing::EditOrder::Shared orderOf(const std::shared_ptr<const Resources>& resources, const std::string& name) {
  if (!resources->limits.takesEdits) return {};
  return {resources->bus, name, std::shared_ptr<const scheduling::Timer>(resources, resources->timer.get())};
}

const char* nameOf(const edits::Operation& operation) {
  constexpr const char* kNames[] = {"raise", "crater", "level", "smooth", "road", "stamp", "undo"};
  static_assert(std::size(kNames) == std::variant_size_v<decltype(operation.what)>);
  return kNames[operation.what.index()];
}

// Who changed the ground. The log bounds these lines; the edits themselves say it of each.
void audit(const std::string& session, const std::string& text, const std::string& what, std::uint64_t number) {
  constexpr std::string_view kToken = "token of ", kAddress = "address ";
  const edits::Author author = edits::authorOf(text);
  logging::About about{.session = session, .event = "edited", .reason = "made"};
  if (author.client.starts_with(kToken)) about.holder = std::string_view(author.client).substr(kToken.size());
  if (author.client.starts_with(kAddress)) about.peer = std::string_view(author.client).substr(kAddress.size());
  logging::info(about, "edit " + std::to_string(number) + " (" + what + ") was made by " + author.client +
                           (author.name.empty() ? "" : ", which calls itself '" + author.name + "'"));
}

}  // namespace

Session::Session(std::string name, std::shared_ptr<const terrain::Terrain> terrain, WorldSpec spec,
                 std::shared_ptr<const Resources> resources, std::shared_ptr<CameraQuota> quota, editing::Edits::Kept kept)
    : name_(std::move(name)),
      spec_(std::move(spec)),
      contentHash_(terrain::contentHash(*terrain)),
      nonce_(anyNumber()),
      resources_(std::move(resources)),
      members_(std::make_shared<std::atomic<std::uint32_t>>(0)),
      quota_(std::move(quota)),
      observer_(beginRecording(*resources_, name_, spec_, *terrain, contentHash_, kept)),
      clock_(std::make_shared<clock::SessionClock>(*resources_->timer, spec_.clock, observer_)),
      presence_(std::make_shared<presence::Presence>(*resources_->timer, clock_)),
      edits_(std::make_shared<editing::Edits>(
          std::move(terrain), resources_->editor(), resources_->writer(), resources_->editSpace,
          [live = live_] {
            for (const auto& camera : live->all()) camera->groundChanged();
          },
          editing::measured(std::move(kept), resources_->figures),
          [observer = observer_, resources = resources_](const editing::Applied& made) {
            if (observer) observer->note(resources->timer->now(), recording::Edited{made.number, made.author, made.operation});
          },
          resources_->limits.turn, orderOf(resources_, name_))),
      editPages_(std::make_shared<editing::EditPages>(edits_, *resources_->executor)) {
  edits_->begin();
  if (resources_->bus->server() == 0) return;
  presence_->share(resources_->bus, "members/" + name_);
  // Another world under this name has another clock.
  clock_->share(resources_->bus, "clock/" + name_ + "/" + std::to_string(contentHash_), [weak = std::weak_ptr(presence_)] {
    if (const auto presence = weak.lock()) presence->tellForStep();
  });
}

std::uint64_t Session::hashOf(const editing::Ground& ground) const {
  if (ground.edit == 0) return contentHash_;
  return lattice::mix(contentHash_ + ground.edit) ^ (ground.identity != 0 ? ground.identity : nonce_);
}

void Session::edit(editing::Edit edit, const std::shared_ptr<Budgets>& budgets, std::function<void(const editing::Edits::Answer&)> done) {
  expects(done != nullptr, "an edit is answered");
  use();
  const auto spent = std::make_shared<std::uint64_t>(0);
  const auto* const undo = std::get_if<edits::Undo>(&edit.operation.what);
  std::string what = nameOf(edit.operation) + (undo ? " of " + std::to_string(undo->edit) : std::string());
  std::string author = edit.author;
  auto ask = [edits = edits_, resources = resources_, budgets, spent, name = name_, author = std::move(author), what = std::move(what),
              done, edit = std::make_shared<editing::Edit>(std::move(edit))] {
    edits->ask(
        std::move(*edit),
        [resources, budgets, spent, name, author, what, done](const editing::Edits::Answer& number, std::uint64_t posts) {
          budgets->spendRest(*spent, posts, resources->timer->now());
          if (number && posts > 0) audit(name, author, what, *number);
          count(*resources->figures, number);
          done(number);
        },
        [resources, budgets, spent](const edits::Operation& operation, std::size_t bytes) -> Outcome<void> {
          const auto now = budgets->spendEdit(operation, bytes, resources->timer->now());
          if (!now) return now.error();
          *spent = *now;
          return {};
        });
  };
  if (!claim_ || claiming_->isDone) return ask();
  const auto early = [resources = resources_, done = std::move(done)](Error why) {
    editing::Edits::Answer answer(std::move(why));
    answer.why = editing::Edits::Answer::Why::kEarly;
    count(*resources->figures, answer);
    done(answer);
  };
  if (!raise(claiming_->waiting, kMaxClaiming)) return early({"Too many edits wait for the first one; send it again in a second."});
  claim_([claiming = claiming_, ask = std::move(ask), early](const Outcome<void>& claimed) {
    --claiming->waiting;
    if (!claimed) return early(claimed.error());
    claiming->isDone = true;
    ask();
  });
}

Outcome<Membership> Session::enter(const std::string& client) {
  const Limits& limits = resources_->limits;
  auto quota = quota_->take();
  if (!quota) return quota.error();
  if (!raise(*members_, limits.maxMembers - std::min<std::uint32_t>(limits.maxMembers, membersElsewhere_))) {
    if (*members_ & kEnded) return Error{"Session '" + name_ + "' has just ended because it was empty; connect again to create it."};
    return Error{"Session '" + name_ + "' is full: it has " + std::to_string(limits.maxMembers) + " members; try again later."};
  }
  std::shared_ptr<const void> slot(
      nullptr, [members = members_](const void*) { expects((members->fetch_sub(1) & ~kEnded) > 0, "who leaves was a member"); });
  return Membership{std::move(*quota), std::move(slot), budgetsOf(client), client};
}

bool Session::end() {
  std::uint32_t nobody = 0;
  if (!members_->compare_exchange_strong(nobody, kEnded)) return false;
  edits_->end();
  clock_->end();
  return true;
}

void Session::retire() {
  isRetired_ = true;
  edits_->end();
  clock_->leave();
}

}  // namespace ridgecast::session
