// SPDX-License-Identifier: Apache-2.0
#include "runtime_min/src/json_cursor.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

namespace envbake::runtime {
namespace {

constexpr std::string_view kDocument = R"( {
  "tool": "envbake 1.0", "odd \" key": [1, {"a": "}]"}], "empty": {}, "none": [],
  "environment": { "skip": [[[]], "\\\"", null, true, -1e3],
                   "mips": {"count": 5, "levels": [{"level": 0, "roughness": 0.0},
                                                   {"level": 1, "roughness": 2.5e-1}]} },
  "brdf": {"ggx": {"axes": "sqrt", "axes": "linear", "quoted": "a\"b"}}, "last": -12.75
} )";

TEST(JsonCursor, FindsByPath) {
    const JsonCursor root(kDocument);
    EXPECT_EQ(root.find("environment/mips/count")->integer(), 5u);
    EXPECT_EQ(root.find("brdf/ggx/axes")->string(), "sqrt");
    EXPECT_EQ(root.find("tool")->string(), "envbake 1.0");
    EXPECT_EQ(root.find("last")->number(), -12.75);
    EXPECT_FALSE(root.find("environment/mips/missing"));
    EXPECT_FALSE(root.find("environment/mips/count/deeper"));
    EXPECT_FALSE(root.find("tool/x"));
    EXPECT_FALSE(root.find("empty/x"));
    EXPECT_FALSE(root.find(""));
    EXPECT_FALSE(root.find("brdf//ggx"));
    EXPECT_FALSE(root.find("a"));  // a key of something that is skipped
}

TEST(JsonCursor, TrueIsTheWholeWord) {
    for (const char* text : {"true", " true ", "true,"}) EXPECT_TRUE(JsonCursor(text).is_true());
    for (const char* text : {"", "t", "tru", "truely", "false", "1", "\"true\"", "[true]"})
        EXPECT_FALSE(JsonCursor(text).is_true()) << text;
}

TEST(JsonCursor, KindsDoNotMix) {
    const JsonCursor root(kDocument);
    EXPECT_FALSE(root.find("tool")->number());
    EXPECT_FALSE(root.find("last")->string());
    EXPECT_FALSE(root.find("last")->integer());
    EXPECT_FALSE(root.find("environment")->number());
    EXPECT_FALSE(root.find("brdf/ggx/quoted")->string());
    EXPECT_FALSE(root.find("environment")->for_each_element([](JsonCursor) { return true; }));
}

TEST(JsonCursor, WalksArrays) {
    std::vector<double> found;
    const JsonCursor root(kDocument);
    EXPECT_TRUE(root.find("environment/mips/levels")->for_each_element([&](JsonCursor entry) {
        found.push_back(*entry.find("roughness")->number());
        return true;
    }));
    EXPECT_EQ(found, (std::vector<double>{0, 0.25}));
    int calls = 0;
    EXPECT_TRUE(root.find("none")->for_each_element([&](JsonCursor) { return ++calls > 0; }));
    EXPECT_EQ(calls, 0);
    EXPECT_FALSE(
        root.find("environment/skip")->for_each_element([&](JsonCursor) { return ++calls < 3; }));
    EXPECT_EQ(calls, 3);
}

TEST(JsonCursor, SeparatorsAreRequired) {
    const auto walks = [](std::string_view text) {
        return JsonCursor(text).for_each_element([](JsonCursor) { return true; });
    };
    EXPECT_TRUE(walks("[1, [2], {\"a\": 3}]"));
    for (const char* bad : {"[1 2]", "[1,]", "[,1]", "[1", "[1}", "[1, 2", "[}"}) {
        EXPECT_FALSE(walks(bad)) << bad;
    }
    EXPECT_TRUE(JsonCursor("{\"a\": 1, \"b\": 2}").find("b"));
    for (const char* bad :
         {"{\"a\": 1 \"b\": 2}", "{\"a\": 1; \"b\": 2}", "{\"a\" 1, \"b\": 2}", "{\"a\", \"b\": 2}",
          "{a: 1, \"b\": 2}", "[\"b\": 2]", "{\"a\":, \"b\": 2}"}) {
        EXPECT_FALSE(JsonCursor(bad).find("b")) << bad;
    }
}

TEST(JsonCursor, Numbers) {
    const auto number = [](std::string_view text) { return JsonCursor(text).number(); };
    EXPECT_EQ(number("0"), 0);
    EXPECT_EQ(number("-7"), -7);
    EXPECT_EQ(number("16777217"), 16777217);
    EXPECT_NEAR(*number("0.3333333333333333"), 1.0 / 3, 1e-16);
    EXPECT_NEAR(*number("6.25E+2"), 625, 1e-12);
    EXPECT_NEAR(*number("0.1000000000000000055511151231257827021181583404541015625"), 0.1, 1e-16);
    EXPECT_EQ(number("1e-999999999999"), 0);
    EXPECT_EQ(number("0e999999999999"), 0);
    for (const char* bad : {"", "-", ".5", "5.", "1e", "1e+", "+1", "1x", "nan", "1e999999999999",
                            "1e300", "--1", "0.1.2"}) {
        EXPECT_FALSE(number(bad)) << bad;
    }
    EXPECT_FALSE(number(std::string(400, '9') + "e-400"));
    EXPECT_EQ(JsonCursor("9007199254740993").integer(), std::nullopt);  // not below 2^53
    EXPECT_EQ(JsonCursor("4.0").integer(), 4u);
}

// An exactly sized copy, so that the address sanitizer sees a read past the end.
bool walk(const std::string& text) {
    const std::vector<char> copy(text.begin(), text.end());
    const JsonCursor root(std::string_view(copy.data(), copy.size()));
    bool found = false;
    for (const char* path : {"environment/mips/count", "brdf/ggx/axes", "last", "odd"}) {
        if (const auto value = root.find(path)) {
            found = value->integer() || value->string() || value->number() || found;
            value->for_each_element([](JsonCursor) { return true; });
        }
    }
    if (const auto list = root.find("environment/skip")) {
        list->for_each_element([&](JsonCursor e) { return e.number() || e.string() || true; });
    }
    return found;
}

TEST(JsonCursor, TruncationsAndGarbageEndCleanly) {
    const std::string whole(kDocument);
    EXPECT_TRUE(walk(whole));
    for (std::size_t size = 0; size < whole.size(); ++size) walk(whole.substr(0, size));
    // What the search needs is cut off: it must not be found.
    EXPECT_FALSE(walk(whole.substr(0, whole.find("environment"))));

    std::uint32_t state = 1;
    for (int round = 0; round < 20000; ++round) {
        std::string text = whole;
        for (int change = 0; change < 3; ++change) {
            state = state * 1664525 + 1013904223;
            constexpr std::string_view kBytes = "{}[]\",:\\ 0e-.\x01\xff";
            text[state % text.size()] = kBytes[(state >> 20) % kBytes.size()];
        }
        walk(text);
    }
}

TEST(JsonCursor, DepthIsLimited) {
    const auto nested = [](int depth) {
        const auto count = static_cast<std::size_t>(depth);
        return "{\"deep\": " + std::string(count, '[') + std::string(count, ']') + ", \"x\": 1}";
    };
    const std::string deep = nested(JsonCursor::kMaxDepth);
    EXPECT_TRUE(JsonCursor(deep).find("x"));
    const std::string too_deep = nested(JsonCursor::kMaxDepth + 1);
    EXPECT_FALSE(JsonCursor(too_deep).find("x"));
    const std::string bottomless = "{\"deep\": " + std::string(1000000, '[');
    EXPECT_FALSE(JsonCursor(bottomless).find("x"));
}

}  // namespace
}  // namespace envbake::runtime
