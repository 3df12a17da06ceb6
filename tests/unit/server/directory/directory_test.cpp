// Which sessions there are, and that no disk holds up who asks for another.
#include "server/directory/directory.h"

#include <gtest/gtest.h>
#include <sqlite3.h>

#include <chrono>
#include <future>
#include <memory>
#include <string>
#include <string_view>

#include "server/edit_log/log.h"
#include "tests/support/process.h"

#include "tests/unit/server/member/session_fixture.h"

namespace ridgecast::session {
namespace {

// While one of these lives, whoever opens a file of this name waits until goOn().
class SlowDisk : private sqlite3_vfs {
 public:
  explicit SlowDisk(std::string name) : sqlite3_vfs(*sqlite3_vfs_find(nullptr)), under_(sqlite3_vfs_find(nullptr)), name_(std::move(name)) {
    zName = "slow";
    xOpen = [](sqlite3_vfs* vfs, sqlite3_filename file, sqlite3_file* out, int flags, int* outFlags) {
      SlowDisk& self = *static_cast<SlowDisk*>(vfs);
      if (file && std::string_view(file).ends_with(self.name_)) {
        self.opening_.set_value();
        self.goesOn_.wait();
      }
      return self.under_->xOpen(self.under_, file, out, flags, outFlags);
    };
    sqlite3_vfs_register(this, 1);
  }
  ~SlowDisk() { sqlite3_vfs_unregister(this); }
  SlowDisk(const SlowDisk&) = delete;
  SlowDisk& operator=(const SlowDisk&) = delete;
  void awaitOpening() { opening_.get_future().wait(); }
  void goOn() { goOn_.set_value(); }

 private:
  sqlite3_vfs* const under_;
  const std::string name_;
  std::promise<void> opening_, goOn_;
  const std::shared_future<void> goesOn_ = goOn_.get_future().share();
};

TEST(Directory, ASlowDiskForOneSessionHoldsUpNobodyElse) {
  const testing_support::ScratchFolder folder;
  ASSERT_TRUE(edit_log::Log::create(folder / "slow.edits",
                                    {std::string(flatTerrain()->name()), flatTerrain()->seed(), {}, terrain::contentHash(*flatTerrain())}));
  scheduling::Executor executor{scheduling::Executor::WithoutThreads{}};
  const auto resources = std::make_shared<Resources>();
  resources->executor = &executor;
  resources->state = folder / "";
  const auto directory = std::make_shared<Directory>(resources, flatTerrain());
  SlowDisk disk("slow.edits");
  auto slow = std::async(std::launch::async, [&] { return directory->add("slow", flatTerrain()); });
  disk.awaitOpening();
  const auto others = std::async(std::launch::async, [&] {
    EXPECT_TRUE(directory->find(kDefaultName));
    EXPECT_FALSE(directory->find("slow")) << "it is not there yet";
    EXPECT_FALSE(directory->reserve("slow").value()) << "its name is taken";
    EXPECT_TRUE(directory->add("other", flatTerrain()));
    EXPECT_TRUE(directory->replace(directory->find("other"), flatTerrain(6)));
    EXPECT_EQ(directory->all().size(), 2u);
    EXPECT_FALSE(directory->full("client"));
    EXPECT_TRUE(directory->remove("other"));
  });
  EXPECT_EQ(others.wait_for(std::chrono::minutes(1)), std::future_status::ready);
  disk.goOn();
  EXPECT_TRUE(slow.get());
  EXPECT_TRUE(directory->find("slow"));
}

TEST_F(SessionTest, DirectoryKnowsSessionsByName) {
  start();
  EXPECT_TRUE(directory->find("default"));
  EXPECT_FALSE(directory->find("nowhere"));
  EXPECT_FALSE(directory->find(""));
  EXPECT_TRUE(directory->add("alps-2", flatTerrain()));
  EXPECT_FALSE(directory->add("alps-2", flatTerrain()));
  EXPECT_FALSE(directory->add("no spaces", flatTerrain()));
  EXPECT_FALSE(directory->add("default", flatTerrain()));
}

TEST_F(SessionTest, ASuccessorTakesNameSpecAndMakersShare) {
  Limits limits;
  limits.maxSessionsPerClient = 1;
  start(limits);
  const auto old = directory->add("alps", flatTerrain(5), {{"tallest", 3}}, "client").value();
  const auto member = old->enter();
  const Session* prepared = nullptr;
  EXPECT_TRUE(directory->replace(old, flatTerrain(6), [&](const Session& successor) {
    prepared = &successor;
    EXPECT_EQ(directory->find("alps"), old);
  }));
  const auto now = directory->find("alps");
  EXPECT_EQ(now.get(), prepared);
  EXPECT_NE(now, old);
  EXPECT_EQ(now->spec(), old->spec());
  EXPECT_NE(now->contentHash(), old->contentHash());
  EXPECT_TRUE(old->isRetired());
  EXPECT_FALSE(now->isRetired());
  EXPECT_TRUE(directory->full("client"));
  EXPECT_EQ(directory->cameras(), 2u);                    // with the fixture's
  EXPECT_FALSE(directory->replace(old, flatTerrain(7)));  // is not there any more
  EXPECT_EQ(directory->find("alps"), now);
}

}  // namespace
}  // namespace ridgecast::session
