#include "client/evaluation/table.h"

#include <gtest/gtest.h>

#include <limits>

namespace ridgecast::evaluation {
namespace {

const Table kTable{"name", "A <title>", "A note.", {"what", "a, b"}, {{"x \"y\"", "1"}, {"z", ""}}};

TEST(Table, CsvQuotesWhatNeedsIt) { EXPECT_EQ(asCsv(kTable), "what,\"a, b\"\r\n\"x \"\"y\"\"\",1\r\nz,\r\n"); }

TEST(Table, AnEmptyFirstCellKeepsItsPlace) { EXPECT_EQ(asCsv({"n", "t", "", {"", "b"}, {{"", "2"}}}), ",b\r\n,2\r\n"); }

TEST(Table, HtmlEscapes) {
  const std::string html = asHtml(kTable);
  EXPECT_NE(html.find("<h3>A &lt;title></h3>"), std::string::npos);
  EXPECT_NE(html.find("<td>x &quot;y&quot;"), std::string::npos);
}

TEST(Table, MarkdownHasARuleUnderItsHeader) {
  EXPECT_EQ(asMarkdown({"n", "Title", "", {"a", "b"}, {{"1", "2"}}}), "## Title\n\n| a | b |\n|---|--:|\n| 1 | 2 |\n\n");
}

TEST(Table, WhatIsNoNumberIsAnEmptyCell) {
  EXPECT_EQ(cell("%.2f", 1.005e3), "1005.00");
  EXPECT_EQ(cell("%.2f", std::numeric_limits<double>::quiet_NaN()), "");
  EXPECT_EQ(cell("%.2f", std::numeric_limits<double>::infinity()), "");
}

}  // namespace
}  // namespace ridgecast::evaluation
