// Metrics have one name, one number and sound limits each.
#include "common/settings/settings.h"

#include <gtest/gtest.h>

#include "ridgecast/v1/stream.pb.h"

namespace ridgecast::settings {
namespace {

TEST(Metrics, AreFoundByTheirNames) {
  for (std::size_t k = 0; k < kMetrics.size(); ++k) EXPECT_EQ(metricNamed(kMetrics[k].name), static_cast<Metric>(k));
  for (const char* none : {"", "pixel", "Area", "thesis "}) EXPECT_FALSE(metricNamed(none)) << none;
}

TEST(Metrics, HaveTheNumbersOfTheProtocol) {
  namespace pb = ridgecast::v1;
  EXPECT_EQ(kMetrics.size(), std::size_t{pb::Metric_ARRAYSIZE});
  for (const auto& [metric, number] : {std::pair{Metric::kDefault, pb::METRIC_DEFAULT}, std::pair{Metric::kPixels, pb::METRIC_PIXELS},
                                       std::pair{Metric::kThesis, pb::METRIC_THESIS}, std::pair{Metric::kArea, pb::METRIC_AREA}})
    EXPECT_EQ(static_cast<int>(metric), static_cast<int>(number));
}

TEST(Metrics, HaveDefaultsThatAreGranted) {
  for (const MetricTraits& m : kMetrics) {
    EXPECT_LE(m.least, m.threshold) << m.name;
    EXPECT_GE(m.most, m.threshold) << m.name;
  }
  EXPECT_EQ(traits(Metric::kDefault).threshold, traits(Metric::kPixels).threshold);
}

}  // namespace
}  // namespace ridgecast::settings
