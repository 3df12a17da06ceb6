#pragma once
// How busy other programs kept the machine during a measurement: only times with a low share are worth anything.

#include <optional>

namespace ridgecast::evaluation {

class Others {
 public:
  Others();  // begins now
  // CPU share of other processes since then, 0..1; empty if the machine does not say (/proc/stat). Children of this process count as its
  // own once they have ended.
  std::optional<double> share() const;

 private:
  struct Times {
    double all = 0, busy = 0, own = 0;  // seconds
  };
  static std::optional<Times> now();
  std::optional<Times> began_;
};

}  // namespace ridgecast::evaluation
