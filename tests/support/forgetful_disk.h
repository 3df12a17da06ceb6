#pragma once
// A disk for SQLite that forgets: what was written and not synced stays in memory. A power cut loses any of it, tears one write at a border
// of 512 bytes, and may bring removed files back; nothing can be written until the power returns. SQLite's default while one of these
// lives. One at a time.

#include <cstdint>
#include <random>

namespace ridgecast::testing_support {

class ForgetfulDisk {
 public:
  explicit ForgetfulDisk(std::mt19937_64& random);
  ~ForgetfulDisk();
  ForgetfulDisk(const ForgetfulDisk&) = delete;
  ForgetfulDisk& operator=(const ForgetfulDisk&) = delete;

  // At the n-th write, sync or removal from now on, 1 or more.
  void cutPowerAfter(std::uint64_t operations);
  void cutPower();
  // From the n-th write on the disk is full, until it is emptied or the power returns.
  void fillAfter(std::uint64_t operations);
  void empty();
  void restorePower();
  bool isOff() const;
  std::uint64_t lost() const;  // writes that power cuts have undone or torn
};

}  // namespace ridgecast::testing_support
