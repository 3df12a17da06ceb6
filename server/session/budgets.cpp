#include "server/session/budgets.h"

#include <algorithm>

#include "common/outcome/contract.h"

namespace ridgecast::session {

Outcome<std::uint64_t> Budgets::spendEdit(const edits::Operation& operation, std::size_t bytes, Time now) {
  expects(bytes > 0, "an edit has bytes");
  const auto owed = std::max(edits.free() - now - kEditDebt, editBytes.free() - now - kEditBytesDebt);
  if (owed.count() > 0)
    return Error{"Too many or too large edits at once; send it again in " +
                 std::to_string(std::chrono::ceil<std::chrono::milliseconds>(owed).count()) + " ms."};
  editBytes.spend(now, bytes);
  const auto area = static_cast<std::uint64_t>(std::min(edits::areaOf(operation).count(), edits::kMaxPosts));
  const std::uint64_t posts = std::max(area, kMinEditedPosts);
  edits.spend(now, posts);
  return posts;
}

std::shared_ptr<Budgets> BudgetsByClient::of(const std::string& client, Budgets::Time now) {
  if (client.empty()) return std::make_shared<Budgets>(heightsPerSecond_);
  const std::lock_guard lock(mutex_);
  std::erase_if(budgets_, [&](const auto& entry) {
    Budgets& its = *entry.second;
    return entry.second.use_count() == 1 && its.areFull(now) &&
           !(isShared_ && std::ranges::any_of(its.all(), &conversation::SharedBudget::hasSpent));
  });
  auto& own = budgets_[client];
  if (!own) own = std::make_shared<Budgets>(heightsPerSecond_);
  return own;
}

std::vector<Spent> BudgetsByClient::takeSpent() {
  std::vector<Spent> all;
  const std::lock_guard lock(mutex_);
  isShared_ = true;
  for (const auto& [client, budgets] : budgets_) {
    Spent spent{client};
    std::ranges::transform(budgets->all(), spent.amounts.begin(), &conversation::SharedBudget::takeSpent);
    if (spent.amounts != Spent().amounts) all.push_back(std::move(spent));
  }
  return all;
}

void BudgetsByClient::charge(const Spent& spent, Budgets::Time now) {
  const auto budgets = of(spent.client, now);
  for (std::size_t k = 0; k < spent.amounts.size(); ++k)
    if (spent.amounts[k] > 0) budgets->all()[k]->charge(now, spent.amounts[k]);
}

}  // namespace ridgecast::session
