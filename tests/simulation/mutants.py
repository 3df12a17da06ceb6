#!/usr/bin/env python3
"""Plants faults in a copy of the tree, one after the other, and says which of them are found, by the simulation or by the test that a
fault names:  mutants.py [--check | SEEDS [WORD]]

--check: only that what each replaces stands in the tree, once.
SEEDS: simulated for a fault, by default 2000. WORD: only the faults whose file, text or test has it. The copy is build/mutants, with builds
of its own."""
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
COPY = ROOT / "build/mutants"
SEVERAL = "several servers"
FIRST_OF_SEVERAL = 1_000_000  # World::kSeveral
# File, what stands there once, what stands there instead; where it is not the simulation that must find it, the preset and the test, or
# SEVERAL: its seeds of several servers.
MUTANTS = [
    ("server/replica/replica.h", "unacknowledged_.size() < window_;", "unacknowledged_.size() <= window_;"),
    ("server/replica/replica.cpp", "    meshHash_ -= mesh::hashTerm(held->address, held->hash);\n", ""),
    ("server/replica/replica.cpp",
     "differs = held->hash != leaf.hash;",
     "differs = held->version != leaf.version && lastSent_ % 64 != 0;"),
    ("server/replica/replica.cpp",
     "scratch_.push_back({leaf.address, 0, 0, leaf.hash, false});",
     "scratch_.push_back({leaf.address, 0, 0, leaf.hash + 1, false});"),
    ("server/replica/replica.cpp",
     "changes.anew = lastSent_ == 0 || repairs(leaves);",
     "changes.anew = repairs(leaves);"),
    ("server/conversation/conversation.cpp",
     "    poses_.pop_front();\n",
     "    poses_.size() > 2 ? poses_.clear() : poses_.pop_front();\n"),
    ("server/conversation/conversation.cpp",
     "  current_.owesAnswer = current_.isForGround || !poses_.empty();\n",
     "  current_.owesAnswer = current_.isForGround || (!poses_.empty() && !atRest_);\n"),
    ("server/conversation/conversation.cpp", "  atRest_ = settled;\n", "  atRest_ = true;\n"),
    ("server/conversation/conversation.cpp", "settled && !atRest_;", "false;"),
    ("server/conversation/conversation.cpp",
     "if (queuedBytes > terms_.maxQueuedBytes) return false;",
     "if (queuedBytes > 2 * terms_.maxQueuedBytes) return false;"),
    ("server/conversation/conversation.cpp",
     "  if (!lockstep()) poses_.clear();\n",
     "  if (!lockstep() && poses_.size() > 1) poses_.pop_back();\n"),
    ("server/conversation/conversation.cpp", "!atRest_ || !changes_.empty()", "!atRest_"),
    ("server/member/camera_session.cpp", "  session_->presence().leave(id_);\n", ""),
    ("server/member/camera_session.cpp", "      wake();\n      return;\n", "      return;\n"),
    ("server/member/camera_session.cpp", "    sender_->send(wire::Granted{*order.granted});\n", ""),
    ("server/scheduling/timer.h", "      isSet_ = false;\n", ""),
    ("server/member/camera_session.cpp", "if (!due && conversation_.due(0)) ", "if (false) "),
    ("server/presence/news.cpp", "left_.push_back(camera);", "(void)camera;"),
    ("server/presence/presence.cpp", "if (*entry.queued >= (isForStep ? kMaxQueued : 1)) return schedule(entry, now + kMinPause);", "if (*entry.queued >= (isForStep ? kMaxQueued : 1)) return;"),
    ("server/presence/news.cpp", "if (&who != &self && !waits(who)) tell(who, out);", "tell(who, out);"),
    ("server/clock/session_clock.cpp", "  if (!all) notifyAlarm_.set", "  if (false) notifyAlarm_.set"),
    ("server/clock/session_clock.cpp", "  watchStep();\n  for (auto&", "  for (auto&"),
    ("server/clock/clock.cpp", "  state_.time = time(now);\n", ""),
    ("server/clock/clock.cpp", "bool changed = state_.waitsFor.erase(member) > 0;", "bool changed = false;"),
    ("server/clock/clock.cpp", "  state_.waitsFor.erase(state_.owner);  // nobody waits for the owner\n", ""),
    ("server/questions/queries.cpp",
     "  pending_.pop_front();\n",
     "  if (pending_.size() > 1) pending_.pop_back();\n  else pending_.pop_front();\n"),
    ("server/questions/queries.cpp",
     "    if (std::exchange(runs_, true)) return true;\n",
     "    if (std::exchange(runs_, true)) return true;\n    if (*open_ > 2) return true;\n"),
    ("server/session/camera_quota.cpp", "  --quota_->cameras_;\n", ""),
    ("client/core/mesh/follower.cpp", "  scene_.reconnect(unnamed);\n", ""),
    ("client/core/mesh/scene.cpp", "iteration_.number == 1 || !iteration_.whole.empty()", "!iteration_.whole.empty()"),
    ("client/core/mesh/point_mesh.cpp",
     "  if (!replaceLeaves(step)) return false;\n  open_.clear();\n",
     "  if (!replaceLeaves(step)) return false;\n"),
    # Acknowledged before it is on the disk.
    ("server/editing/edits.cpp",
     "  if (!batch_.made.empty()) return append();\n",
     "  for (std::size_t k = 0; k < batch_.done; ++k)\n    for (const Done& done : std::exchange(group_[k]->done, {})) done(*group_[k]->answer, 0);\n"
     "  if (!batch_.made.empty()) return append();\n"),
    ("server/editing/edits.cpp", "if (!batch_.made.empty() && !batch_.isKept && !order_->isShared()) refuseMade(full(batch_.isKept.error().message));", ""),
    ("server/edit_log/log.cpp", "PRAGMA synchronous = EXTRA", "PRAGMA synchronous = NORMAL"),
    ("server/edit_log/log.cpp",
     "if (auto begun = transaction.begin(); !begun) return begun.error();\n  std::uint64_t next = last_;",
     "std::uint64_t next = last_;"),
    # Keys.
    ("server/editing/edits.cpp", "  if (auto kept = keptWith(asked.key, asked)) return kept;\n", ""),
    ("server/editing/edits.cpp", "asked.key = edit.author + '\\n' + edit.key;", "asked.key = edit.key;"),
    # Members have names in common.
    ("server/editing/edits.cpp",
     "asked.key = edit.author + '\\n' + edit.key;",
     "asked.key = edits::authorOf(edit.author).name + '\\n' + edit.key;"),
    ("server/member/camera_edits.cpp", "edits::toText({membership_.client, conversation_.hello().clientName})", "conversation_.hello().clientName"),
    ("server/editing/edits.cpp",
     "if (!isMadeOf(asked, open->second->asked)) return ofAnother(0);",
     ""),
    ("server/editing/edits.cpp", "return !made->empty() && isMadeOf(asked, made->front()) ? Answer(**number) : ofAnother(**number);", "return Answer(**number);"),
    # Keys that wait.
    ("server/editing/edits.cpp", "open->second->done.push_back(std::exchange(done, nullptr));\n    return {};", "return {};"),
    ("server/editing/edits.cpp", "if (!waits->asked.key.empty()) open_[waits->asked.key] = waits;", ""),
    ("server/editing/edits.cpp", "for (std::size_t k = 0; k < batch_.done; ++k) open_.erase(group_[k]->asked.key);", "if (batch_.made.empty()) open_.clear();"),
    # Numbers and their order.
    ("server/editing/edits.cpp", "  batch_.made.clear();\n  batch_.checked.clear();\n", "  batch_.checked.clear();\n"),
    ("server/editing/edits.cpp", "history_.takeBack(batch_.before);", "history_.takeBack(history_.layer());"),
    # Told before it is kept, or before its ground is there.
    ("server/editing/edits_reading.cpp", "while (!edits->empty() && edits->back().number > last) edits->pop_back();", ""),
    ("server/editing/edits_reading.cpp", "kept_.store->read(r.after, r.most);", "kept_.store->read(r.after + (r.after % 8 == 7), r.most);"),
    ("server/editing/edit_pages.cpp", "last = message.edits.back().number;", "last = message.edits.front().number;"),
    ("server/member/camera_session.cpp", "  news_.told = std::max(hello.editsAfter, session_->edits().compacted());\n", "  news_.told = 0;\n"),
    ("server/member/camera_edits.cpp", "  news_.isOnItsWay = false;\n  tellEdits();\n", "  news_.isOnItsWay = false;\n"),
    # Undos.
    ("common/edits/undo.cpp", "    more = counted ? -1 : 1;\n", "    more = 1;\n"),
    ("common/edits/history.cpp", "edit != 0 && entries_.undos(k) == 0) ++entries_", "edit != 0) ++entries_"),
    ("common/edits/undo.cpp", "      if (const Posts fresh = addTo(undo.changed, area);", "      if (const Posts fresh;"),
    ("common/edits/undo.cpp", "addTo(undo.needed, area.wider(marginOf(smooth)));", "addTo(undo.needed, area);"),
    ("common/edits/undo.cpp", "        cost += addSmooths(fresh.wider(kMaxPasses), edit, last_ + 1, undo, open);\n", "        ++cost;\n",
     "test edits_test"),
    ("common/edits/undo.cpp", "        cost += addSmooths(fresh, undo.from, edit, undo, open);\n", "        ++cost;\n", "test edits_test"),
    # Beneath many others.
    ("common/edits/undo.cpp", "    for (; next != made.checkpoints.end() && next->edit < compacted_ + edit; ++next)", "    for (; false; ++next)"),
    ("common/edits/history.cpp", "std::erase_if(checkpoints_, [&](const Checkpoint& c) { return c.edit > right; });", "(void)right;"),
    ("common/edits/undo.cpp", "more = isCounted ? 1u : ~0u;", "more = 1u;", "test edits_test"),
    ("common/edits/undo.cpp", "if (compacted_ + edit > undo.from && undo.again.size()",
     "if (compacted_ + edit >= undo.from && undo.again.size()", "test edits_test"),
    ("common/edits/undo.cpp", "  std::ranges::sort(undo.again);\n", "", "test edits_test"),
    ("common/edits/undo.cpp", "meets(area.wider(marginOf(smooth)), undo.changed)", "meets(area, undo.changed)", "test edits_test"),
    ("common/edits/undo.cpp", "[&](const auto& c) { return c.edit < undo.edit; }",
     "[&](const auto& c) { return c.edit <= undo.edit; }", "test edits_test"),
    ("common/edits/undo.cpp", "[&](const Checkpoint& c) { return c.edit >= undo.edit; });\n  auto next",
     "[&](const Checkpoint& c) { return c.edit > undo.edit; });\n  auto next", "test edits_test"),
    ("common/edits/history.cpp", "edit != 0) right = edit - 1;", "edit != 0) right = edit;", "test edits_test"),
    ("common/edits/history.cpp", "  if (const Posts area = areaOf(last); !area.empty()) indexFor(last).remove(",
     "  if (const Posts area = areaOf(last); area.empty()) indexFor(last).remove(", "test edits_test"),
    # Areas.
    ("common/edits/operation.h", "lattice::Area{(p.x0 - 2) * kPostSteps,", "lattice::Area{p.x0 * kPostSteps,"),
    ("common/edits/undo.cpp", "      changed.add(area);\n", ""),
    ("server/editing/edits.cpp", "news.changed.back() = around(news.changed.back(), *area);", "news.changed.back() = *area;"),
    ("server/editing/edits.cpp", "areas_.push_back(m.ground);", "areas_.push_back(batch_.made.back().ground);"),
    # Whoever should follow.
    ("server/member/camera_edits.cpp", "  conversation_.groundChanged();\n", ""),
    ("server/member/camera_session.cpp", "  task_.mesh->setGround(task_.ground.terrain, changed);", "  if (task_.ground.edit % 4 != 3) task_.mesh->setGround(task_.ground.terrain, changed);"),
    ("server/http/map_tiles.cpp", "etagOf(session->hashOf(ground),", "etagOf(session->contentHash(),"),
    ("server/http/map_tiles.cpp", "std::to_string(ground.edit)", "std::to_string(ground.edit / 2)"),
    # Bounds.
    ("server/editing/edits.cpp", "waiting_.size() >= kMaxWaiting)", "waiting_.size() > kMaxWaiting)"),
    ("server/member/camera_edits.cpp", "*openEdits_ >= wire::kMaxEdits + kArrived", "*openEdits_ > wire::kMaxEdits + kArrived"),
    # The cache on the disk.
    # Tiles older than the last edit are left by damage alone, which edit_log_test makes; a server of this version writes both together.
    ("server/edit_log/log.cpp", "put(at, is, meta.tilesHash); !done)", "put(at, is, meta.baseHash); !done)"),
    ("server/edit_log/log.cpp", "  last_ = next;\n  meta_ = meta;\n", "  last_ = next;\n  meta_.tilesOf = next;\n"),
    ("server/edit_log/log.cpp", "if (change.before.tile(at) == change.after.tile(at)) continue;", "if (change.before.tile(at)) continue;"),
    ("server/edit_log/log.cpp", "if (!tile) return sql_->removeTile.run(at.i, at.j);", "if (!tile) return {};"),
    # Over HTTP.
    ("server/http/edits.cpp", "editing::Edit{std::move(key), ", "editing::Edit{std::string(), "),
    ("server/http/edits.cpp", "edits::toText({client, {}})", "std::string()"),
    ("server/http/edits.cpp", "    wake_();\n", ""),
    ("server/http/edits.cpp", "    case editing::Edits::Answer::Why::kEarly:\n", "    case editing::Edits::Answer::Why::kEarly: return json(\"{\\\"number\\\": 1}\");\n"),
    # Memory that runs out.
    ("server/editing/edits.cpp", "    if (batch_.making && history_.last() > batch_.making->last) history_.takeBack(batch_.making->before);\n", ""),
    ("server/editing/edits.cpp",
     "  } catch (const std::bad_alloc&) {\n    if (batch_.making",
     "  } catch (const std::bad_alloc&) {\n    return false;\n    if (batch_.making"),
    # Members that do not read.
    ("server/member/camera_edits.cpp", "!news_.page.expired() || sender_", "sender_"),
    # Two that enter at once, and two servers.
    ("server/directory/reservations.cpp", "if (!names_->taken.insert(name).second) return std::unique_ptr<Reservation>();", "names_->taken.insert(name);"),
    ("server/directory/reservations.cpp", "  kept.held = held_;\n", ""),
    ("server/directory/directory.cpp",
     "    if (self->reservations_.isElsewhere(std::string(kDefaultName))) return self->awaitDefault();\n",
     "    if (self->reservations_.isElsewhere(std::string(kDefaultName))) return;\n"),
    ("server/directory/directory.cpp",
     "  auto reservation = reservations_.take(name);\n  if (reservation && find(name)) reservation->reset();\n",
     "  const std::lock_guard lock(mutex_);\n  auto reservation = reservations_.take(name);\n"
     "  if (reservation && sessions_.contains(name)) reservation->reset();\n",
     "test directory_test"),
    ("server/edit_log/lock.cpp", "F_OFD_SETLK, &range) == 0) return lock;", "F_OFD_GETLK, &range) == 0) return lock;"),
    ("server/edit_log/lock.cpp", "if (file_ >= 0) ::close(file_);", ""),
    # Of several servers: the order of edits, their keys, the clock, members, names, meshes that move.
    ("server/editing/edit_order.cpp",
     "return isUnsure ? resolveAt(answer.last) : decide({Decided::Kind::kLost});",
     "return isUnsure ? resolveAt(answer.last) : decide({});",
     SEVERAL),
    ("server/editing/edit_order.cpp",
     "    case Kind::kUnknown:\n      return retry();",
     "    case Kind::kUnknown:\n      return decide({Decided::Kind::kAway, 0, kAwayNow});",
     SEVERAL),
    ("server/editing/edit_order.cpp",
     "return isUnsure ? resolveAt(answer.last) : decide({Decided::Kind::kLost});",
     "return decide({Decided::Kind::kLost});",
     "test shared_edits_test"),
    ("server/editing/edits_following.cpp",
     "  group_.clear();  // their keys are looked up again on the new ground\n",
     "",
     "test shared_edits_test"),
    ("server/editing/edit_order.cpp",
     "  if (told < own()) return bringBack(told, std::move(done));",
     "  if (told < own()) return pause(kRetry), done({Next::Kind::kAway});",
     SEVERAL),
    ("server/bus/link.cpp",
     "  if (!fault.why.empty()) events_.ended(fault);\n"
     "  for (std::size_t i = 0; i < calls.size(); ++i) calls[i]({i + unsent_ < calls.size() ? Answer::Kind::kLost : Answer::Kind::kUnsent, {}});\n",
     "  for (std::size_t i = 0; i < calls.size(); ++i) calls[i]({i + unsent_ < calls.size() ? Answer::Kind::kLost : Answer::Kind::kUnsent, {}});\n"
     "  if (!fault.why.empty()) events_.ended(fault);\n",
     "test redis_test"),
    ("server/http/worlds.cpp",
     "if (upgrading) return upgradeOnceThere(std::move(session));",
     "if (upgrading) return Upgrade{std::move(session)};",
     SEVERAL),
    ("server/editing/edits_following.cpp",
     "  if (!order_->isShared() || std::none_of(group_.begin(),",
     "  if (order_->isShared() || std::none_of(group_.begin(),",
     "test shared_edits_test"),
    ("server/clock/shared_clock.cpp",
     "!isHere || numbered.number != applied + 1) continue;",
     "!isHere) continue;",
     "test clock_test"),
    ("server/clock/shared_clock.cpp",
     "if (isLeaderBehind_ || now.here - leaderHeard_ >= kSilence) {",
     "if (isLeaderBehind_) {",
     SEVERAL),
    ("server/clock/shared_clock.cpp",
     "    if (show(answer->record.value, now)) lead(now);",
     "    lead(now);",
     "test clock_test"),
    ("server/clock/shared_clock.cpp",
     "if (told->epoch < epoch_ || (told->epoch == epoch_",
     "if ((told->epoch == epoch_",
     "test clock_test"),
    ("server/presence/presence.cpp",
     "if (clock_->endsStepHere(camera, done.step)) bus_ ? shareNow() : tellForStep();",
     "if (clock_->endsStepHere(camera, done.step) && !bus_) tellForStep();",
     "test crowd_test"),
    ("server/clock/session_clock.cpp", "  if (!shared_->turnsStep(said)) return;\n", "  return;\n", "test crowd_test"),
    ("server/presence/presence.cpp",
     "if (now >= at + kSilence && gone.size()",
     "if (now >= at + 100 * kSilence && gone.size()",
     SEVERAL),
    ("server/presence/presence.cpp",
     " && now < entry.shared.at + kRepeat) continue;",
     ") continue;",
     SEVERAL),
    ("server/directory/directory.h",
     "return std::uint64_t{resources_->bus->server()} << 32 | number;",
     "return number;",
     SEVERAL),
    ("server/member/camera_handover.cpp",
     "  task_.ground.edit = checkpoint->edit;  // the next iteration knows the others\n",
     "",
     SEVERAL),
    # Rooms outside the simulation.
    ("common/triangulation/predicates.h", "if (m == &b) return orientation(c, a, d) < 0;", "if (m == &b) return orientation(c, a, d) > 0;",
     "test triangulation_test"),
    ("server/access/jwt.cpp", "if (now >= *grant.expires)", "if (now > *grant.expires)", "test access_test"),
    ("server/map/mercator.cpp", "(std::ldexp(tile.y, 8) + 0.5)", "std::ldexp(tile.y, 8)", "test map_test"),
    ("server/earth/earth.cpp", "at.easting / unit", "at.easting * unit", "test earth_test"),
    ("server/quadtree/quadtree.cpp", "const double merges = side / kMerge,", "const double merges = side / kSplit,", "test quadtree_test"),
    # Memory.
    ("common/codec/codec.cpp", "b >= vertices || c >= vertices", "b >= vertices || c > vertices", "asan codec_test"),
    ("common/raster/tiff_file.cpp", "buffer_.resize(rowBytes_ * (tileWidth_ ? tileHeight_ : 1));", "buffer_.resize(rowBytes_);",
     "asan raster_files_test"),
    ("common/points/points.cpp", "std::min(number(n, static_cast<std::uint32_t>(std::abs(v))), 1u << 30)",
     "number(n, static_cast<std::uint32_t>(std::abs(v)))", "asan points_test"),
    ("client/core/mesh/point_mesh.cpp", "  reserve(vertices.size());\n  allow(", "  allow(", "asan core_mesh_test"),
    # Threads.
    ("client/standing/standing_ground.cpp", "    const std::lock_guard lock(mutex_);\n    ends_ = true;\n", "    ends_ = true;\n",
     "tsan standing_ground_test"),
    ("server/http/jobs.cpp", "std::size_t Jobs::waiting() const {\n  const std::lock_guard lock(mutex_);\n", "std::size_t Jobs::waiting() const {\n",
     "tsan net_test"),
    ("server/recording/recorder.cpp", "bool isEnd) {\n  const std::lock_guard lock(mutex);\n", "bool isEnd) {\n", "tsan recording_test"),
    ("server/scheduling/timer.cpp", "    const std::lock_guard lock(state_->mutex);\n    state_->ends = true;\n", "    state_->ends = true;\n",
     "tsan integration_stream"),
    ("server/box/problem.h", "progress->checked.fetch_add(triangles, std::memory_order_relaxed);",
     "*reinterpret_cast<std::uint32_t*>(&progress->checked) += triangles;", "tsan snapshot_test"),
    ("server/refinement/chooser.cpp", "heights_.fetch_add(trials.size(), std::memory_order_relaxed);",
     "*reinterpret_cast<std::uint64_t*>(&heights_) += trials.size();", "tsan pipeline_test"),
    # Limits to insertions, and what is fresh in a leaf.
    ("server/pipeline/stages.cpp", "left = searchBound.isRaised() ? searchBound.value() : 0;", "left = 0;", "test settled_test"),
    ("server/pipeline/pipeline.cpp", " && !raised", "", "test pipeline_test"),
    ("server/refinement/adaptive_mesh.cpp", "  else\n    candidates_.fold(wanted.triangle, c, regions_[region], view);\n", "",
     "test refinement_test"),
    ("server/refinement/adaptive_mesh.h", "    mesh_.vertexPages().setFresh(v);\n", "", "test encoding_test"),
    ("server/encoding/held_points.cpp", "if (held.size() + list_.size() - known == surface.mesh->vertexCount(mesh.region(leaf)))",
     "if (known <= held.size())", "test encoding_test"),
    # The client's half.
    ("client/core/conversation/outbox.cpp", "  if (pacing_ == wire::Pacing::kFree) poses_.clear();\n", "  if (pacing_ == wire::Pacing::kFree && poses_.size() > 1) return std::nullopt;\n", "test core_conversation_test"),
    ("client/core/conversation/outbox.cpp",
     "  if (all || resend_->leaves.size() > wire::kMaxResendLeaves) resend_->leaves.clear();\n",
     "",
     "test core_conversation_test"),
    ("client/core/conversation/outbox.cpp",
     "  if (!resumes_.empty()) return pop(resumes_);\n  if (resend_)",
     "  if (!poses_.empty()) return pop(poses_);\n  if (!resumes_.empty()) return pop(resumes_);\n  if (resend_)"),
    ("client/core/conversation/outbox.cpp", "if (acknowledge_) return *std::exchange(acknowledge_, std::nullopt);", "if (acknowledge_) return *acknowledge_;", "test core_conversation_test"),
    ("client/core/conversation/outbox.h", "auto answered = open_.extract(reply.id);", "auto answered = open_.extract(open_.begin());"),
    ("client/core/conversation/outbox.h", "open_.size() >= atATime_", "open_.size() > 2 * atATime_", "test core_conversation_test"),
    ("client/core/conversation/outbox.h", "    request.id = ++last_;\n", "    request.id = last_ += waiting_.empty();\n"),
    ("client/core/conversation/conversation.cpp", "  lastEdit_ = std::max(lastEdit_, world_.compacted);\n", "", "test core_conversation_test"),
    ("client/core/conversation/conversation.cpp", "lastEdit_(hello_.editsAfter)", "lastEdit_(0)"),
    ("client/core/conversation/conversation.cpp", "  waitingBytes_ -= received.bytes;\n", "", "test core_conversation_test"),
    ("client/core/conversation/conversation.cpp", "  iterations_.pop_front();\n", "  if (iterations_.size() > 1) iterations_.pop_back();\n  else iterations_.clear();\n", "test core_conversation_test"),
    ("client/core/conversation/conversation.cpp", "  granted_ = granted.settings;\n", ""),
    ("client/core/conversation/conversation.cpp", "    if (asksClock_) asksClock_ = now;\n", "", "test core_conversation_test"),
    ("client/core/conversation/roster.cpp", "    it->second.member.moved = m;\n", "    if (!it->second.member.moved) it->second.member.moved = m;\n"),
    ("client/core/conversation/outbox.h", "    if (failed_) return done(*failed_);\n", "", "test core_conversation_test"),
    ("client/core/conversation/reconnector.cpp", "  if (pose_) current_->send(*pose_);\n", ""),
    ("client/core/conversation/reconnector.cpp", "  for (const wire::Resume& leaves : held) current_->resume(leaves);\n", ""),
    ("client/core/conversation/reconnector.cpp", "  if (hello_.settings != asked_) current_->change(hello_.settings);\n", ""),
    ("client/core/conversation/reconnector.cpp", "  hello_.editsAfter = current_->forgetEdits();\n", ""),
    ("client/core/conversation/reconnector.cpp", "  ofLine().end(why);\n", ""),
    ("client/core/conversation/reconnector.cpp", "    asked_ = hello_.settings;\n", "", "test core_conversation_test"),
    ("client/core/conversation/reconnector.cpp", "  pause_ = std::min(2 * pause_, kLongestPause);\n", "", "test core_conversation_test"),
    ("client/core/conversation/reconnector.cpp", "after.edit < current_->edit() && !current_->isRecording()", "false", "test core_conversation_test"),
    ("client/core/conversation/reconnector.cpp", "  target_ = url_;\n", "", "test core_conversation_test"),
    ("client/core/conversation/reconnector.h", "coming_->hasWorld() && !current_->hasIterations()", "coming_->hasWorld()", "test core_conversation_test"),
    ("client/core/conversation/reconnector.cpp", "  coming_.reset();\n", "", "test core_conversation_test"),
    ("client/core/conversation/reconnector.cpp", "  hello_.settings = settings;\n", "", "test core_conversation_test"),
    ("client/core/conversation/reconnector.cpp", "  current_->skipSteps(skipsSteps_);\n", "", "test core_conversation_test"),
    ("client/core/conversation/reconnector.cpp", "  if (current_->isRecording()) hello_.editsAfter = 0;", "  if (false) hello_.editsAfter = 0;", "test core_conversation_test"),
    ("client/core/conversation/reconnector.cpp", "if (other->host != url_.host) target_", "if (other->port != url_.port) target_", "test core_conversation_test"),
    ("client/core/conversation/conversation.cpp", "  lastEdit_ -= edits_.size();\n", "", "test core_conversation_test"),
    ("client/core/conversation/session_clock.cpp", "  if (!goesOn) best_.reset();\n", "", "test core_conversation_test"),
    ("client/core/mesh/follower.cpp", "  asked_ = false;\n", "", "test follower_test"),
    ("client/core/mesh/scene.cpp", "if (leaf == scene_.index().end() && scene_.lost()) continue;", "if (leaf == scene_.index().end()) continue;", "test core_mesh_test"),
    ("client/core/mesh/scene.cpp", "    made_ = made_ && leaf.mesh;\n", "", "test follower_test"),
    ("client/core/mesh/point_mesh.cpp", "      bounds_[to].add(bounds_[region].low, bounds_[region].high);\n", "", "test follower_test"),
    ("client/core/ground/held_edits.cpp", "    known.isOld = true;\n", "", "test core_ground_test"),
    ("client/core/ground/held_edits.cpp", "if (!*decoded && squares.edit >= known->second.needs) {", "if (!*decoded) {", "test core_ground_test"),
    ("client/core/hands/editing.cpp", "  if (undoes > 0) keep(undoes);\n", "", "test core_hands_test"),
    ("client/core/conversation/conversation.cpp", "kMaterials && world_.revision < 8)", "kMaterials && world_.revision < 7)", "test core_conversation_test"),
    # What the ground is made of.
    ("common/raster/classes.cpp", "if (std::isnan(v) || (header.noData && v == *header.noData)) continue;", "if (std::isnan(v)) continue;", "test raster_files_test"),
    ("common/raster/classes.cpp", "const double i = std::floor(grid_.x.at(x) + 0.5)", "const double i = std::floor(grid_.x.at(x))", "test raster_files_test"),
    ("common/edits/edited_terrain.cpp", "painted != 0) out[k] = painted;", "painted != 0 && out[k] == 0) out[k] = painted;", "test edits_test"),
    ("server/snapshot/attributes.cpp", "x.push_back(v.x), z.push_back(v.z);", "x.push_back(v.z), z.push_back(v.x);", "test snapshot_test"),
    ("common/gltf/glb.cpp", "std::vector<std::uint32_t> offsets{0};", "std::vector<std::uint32_t> offsets;", "test gltf_test"),
    # Who hangs up.
    ("server/net/http.cpp", "while (!awaited.isOver()) {\n      const std::size_t room", "while (!awaited.reply) {\n      const std::size_t room", "test net_test"),
    # The stream's bytes.
    ("common/wire/table.h", "if (found.chosen != kRows<T>) found.held[found.chosen] = {};", "", "test wire_test"),
    ("common/wire/table.h", "    if (there) earlier->push_back(last);\n", "", "test wire_test"),
    ("common/wire/coding.h", "value = bits != 0;", "value = bits & 1;", "test wire_test"),
    ("common/wire/coding.cpp", "takeVarint(bytes, read, 5)", "takeVarint(bytes, read, 4)", "test wire_test"),
    ("common/wire/coding.cpp", "    return content.empty() || content.back() < 0x80;\n", "    return true;\n", "test wire_test"),
]


def build(preset: str, test: str) -> bool:
    if not (COPY / "build" / preset / "build.ninja").exists():
        subprocess.run(["cmake", "--preset", preset], cwd=COPY, stdout=subprocess.DEVNULL, check=True)
    done = subprocess.run(["ninja", "-C", COPY / "build" / preset, test], capture_output=True, text=True)
    if done.returncode:
        print(done.stdout[-2000:])
    return done.returncode == 0


def misplaced() -> list[str]:
    counts = [((ROOT / file).read_text().count(before), file, before) for file, before, *_ in MUTANTS]
    return [f"{file}: '{before.strip()}' stands there {count} times, not once" for count, file, before in counts if count != 1]


def main() -> int:
    if wrong := misplaced():
        sys.exit("\n".join(wrong))
    if sys.argv[1:] == ["--check"]:
        return 0
    seeds = sys.argv[1] if len(sys.argv) > 1 else "2000"
    if not seeds.isdigit():
        sys.exit(__doc__)
    COPY.mkdir(parents=True, exist_ok=True)
    for name in subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\0")[:-1]:
        original, copy = ROOT / name, COPY / name
        if not copy.exists() or copy.read_bytes() != original.read_bytes():
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(original, copy)  # as new as it is to the build
    tsan = f"halt_on_error=1:suppressions={ROOT}/tests/support/tsan-suppressions.txt"
    env = {**os.environ, "SEEDS": seeds, "SHORTEN": "0", "TSAN_OPTIONS": tsan}
    found = 0
    word = sys.argv[2] if len(sys.argv) > 2 else ""
    mutants = [m for m in MUTANTS if any(word in text for text in m)]
    sound = set()
    for file, before, after, *by in mutants:
        isSimulated = not by or by[0] == SEVERAL
        preset, test = ("test", "simulation_test") if isSimulated else by[0].split()
        env["FROM"] = str(FIRST_OF_SEVERAL if by == [SEVERAL] else 1)
        program = [COPY / "build" / preset / "bin" / test]
        if test not in sound and (not build(preset, test) or (not isSimulated and subprocess.run(program, env=env, capture_output=True).returncode)):
            sys.exit(f"{test} fails without a fault")
        sound.add(test)
        path = COPY / file
        text = path.read_text()
        path.write_text(text.replace(before, after))
        try:
            if not build(preset, test):
                sys.exit(f"{file}: '{after.strip()}' does not compile")
            began = time.monotonic()
            try:
                run = subprocess.run(program, env=env, capture_output=True, text=True, timeout=3600)
                seeds = re.findall(r'SEED=([0-9]+)', run.stdout)
                what = "" if not run.returncode else " ".join(by) if not isSimulated else f"seed {seeds[-1]}" if seeds else "a contract"
            except subprocess.TimeoutExpired:
                what = "it hangs"
            found += bool(what)
            seconds = time.monotonic() - began
            print(f"{'found: ' + what if what else 'NOT FOUND':<16} {seconds:5.0f} s  {file}: {before.strip()}", flush=True)
        finally:
            path.write_text(text)
    print(f"{found} of {len(mutants)} found")
    return 0


if __name__ == "__main__":
    sys.exit(main())
