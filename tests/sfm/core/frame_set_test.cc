#include "sfm/core/frame_set.h"

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "tests/support/process.h"

namespace rotunda {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::TemporaryFolder;

Frame MakeFrame(const std::string& camera) {
  Frame frame;
  frame.camera = camera;
  frame.serial = "SN-" + camera;
  frame.file = "frames/" + camera + ".png";
  frame.width_px = 1200;
  frame.height_px = 1600;
  frame.pixel_format = "BayerRG8";
  frame.exposure_us = 4999.7;
  frame.gain_db = 0.1;
  frame.frame_id = UINT64_MAX;
  frame.timestamp_ns = 1718000000123456789;
  frame.xxh3 = "0123456789abcdef";
  return frame;
}

FrameSet MakeSet() {
  FrameSet set;
  set.id = "shot-1";
  set.captured_at = "2024-06-10T06:13:20Z";
  set.subject = "Zoë \"Z\"";
  set.trigger = {
      {"source", "simulated"}, {"armed", true}, {"line", uint64_t{4}}, {"delay_us", -2.5}};
  set.frames = {MakeFrame("c00r0"), MakeFrame("c00r1"), MakeFrame("c01r0")};
  return set;
}

json Parsed(const FrameSet& set) { return json::parse(FrameSetToJson(set)); }

std::string ErrorOf(const json& text) {
  const auto set = FrameSetFromJson(text.dump(), "frameset.json");
  return set.ok() ? "ok" : set.error().ToString();
}

void Touch(const fs::path& file) {
  fs::create_directories(file.parent_path());
  std::ofstream(file) << "x";
}

void ExpectSame(const FrameSet& a, const FrameSet& b) {
  EXPECT_EQ(a.id, b.id);
  EXPECT_EQ(a.captured_at, b.captured_at);
  EXPECT_EQ(a.subject, b.subject);
  EXPECT_EQ(a.trigger, b.trigger);
  ASSERT_EQ(a.frames.size(), b.frames.size());
  for (size_t i = 0; i < a.frames.size(); ++i) {
    const auto tied = [](const Frame& f) {
      return std::tie(f.camera, f.serial, f.file, f.width_px, f.height_px, f.pixel_format,
                      f.exposure_us, f.gain_db, f.frame_id, f.timestamp_ns, f.status, f.xxh3);
    };
    EXPECT_TRUE(tied(a.frames[i]) == tied(b.frames[i])) << "frame " << i;
  }
}

TEST(FrameSetJson, ReadsWhatItWrites) {
  const FrameSet set = MakeSet();
  const auto read = FrameSetFromJson(FrameSetToJson(set), "text");
  ASSERT_TRUE(read.ok()) << read.error().ToString();
  ExpectSame(*read, set);
  EXPECT_EQ(FrameSetToJson(*read), FrameSetToJson(set));
}

TEST(FrameSetJson, HasTheKeysOfTheFormatInOrder) {
  FrameSet set = MakeSet();
  set.frames.resize(1);
  EXPECT_EQ(FrameSetToJson(set), R"({
 "format": "rotunda-frameset/1",
 "id": "shot-1",
 "captured_at": "2024-06-10T06:13:20Z",
 "subject": "Zoë \"Z\"",
 "trigger": {
  "armed": true,
  "delay_us": -2.5,
  "line": 4,
  "source": "simulated"
 },
 "frames": [
  {
   "camera": "c00r0",
   "serial": "SN-c00r0",
   "file": "frames/c00r0.png",
   "width": 1200,
   "height": 1600,
   "pixel_format": "BayerRG8",
   "exposure_us": 4999.7,
   "gain_db": 0.1,
   "frame_id": 18446744073709551615,
   "timestamp_ns": 1718000000123456789,
   "status": "ok",
   "xxh3": "0123456789abcdef"
  }
 ]
}
)");
}

TEST(FrameSetJson, TheTriggersValuesKeepTheirType) {
  const json trigger = json::parse(
      R"({"a": "4", "b": 4, "c": -4, "d": 4.0, "e": false, "f": 18446744073709551615, "g": 1e-9})");
  json text = Parsed(MakeSet());
  text["trigger"] = trigger;
  const auto read = FrameSetFromJson(text.dump(), "text");
  ASSERT_TRUE(read.ok()) << read.error().ToString();
  EXPECT_EQ(Parsed(*read)["trigger"].dump(), trigger.dump());
}

TEST(FrameSetJson, SortsFramesByCamera) {
  FrameSet set = MakeSet();
  std::swap(set.frames[0], set.frames[2]);
  const auto read = FrameSetFromJson(FrameSetToJson(set), "text");
  ASSERT_TRUE(read.ok());
  EXPECT_EQ(read->frames[0].camera, "c00r0");
  EXPECT_EQ(read->frame(ImageId(2)).camera, "c01r0");
}

TEST(FrameSetJson, AFrameThatFailedNeedsNoPicture) {
  FrameSet set = MakeSet();
  set.frames[1].status = "missing";
  set.frames[1].file = "";
  set.frames[1].width_px = set.frames[1].height_px = 0;
  set.frames[1].xxh3 = "";
  const auto read = FrameSetFromJson(FrameSetToJson(set), "text");
  ASSERT_TRUE(read.ok()) << read.error().ToString();
  ExpectSame(*read, set);
}

struct BadField {
  const char* pointer;  // JSON pointer
  json value;           // discarded: the field is taken away
  const char* error;
};

TEST(FrameSetJson, NamesTheFieldWhatWasFoundAndWhatWasExpected) {
  const json gone = json(json::value_t::discarded);
  const std::vector<BadField> table = {
      {"/format", "rotunda-frameset/2",
       "format: expected \"rotunda-frameset/1\", found \"rotunda-frameset/2\""},
      {"/format", gone, "format: expected \"rotunda-frameset/1\", found nothing"},
      {"/id", 5, "id: expected a string, found 5"},
      {"/trigger", json::array(), "trigger: expected an object, found an array of 0"},
      {"/trigger/line", nullptr,
       "trigger.line: expected a string, a number, true or false, found null"},
      {"/trigger/line", json::object(),
       "trigger.line: expected a string, a number, true or false, found an object"},
      {"/frames", gone, "frames: expected an array, found nothing"},
      {"/frames", json::array(), "frames: expected at least one frame, found an array of 0"},
      {"/frames/2", 3, "frames[2]: expected an object, found 3"},
      {"/frames/1/width", "abc",
       "frames[1].width: expected an integer from 1 to 100000, found \"abc\""},
      {"/frames/1/width", 0, "frames[1].width: expected an integer from 1 to 100000, found 0"},
      {"/frames/1/width", 1200.5,
       "frames[1].width: expected an integer from 1 to 100000, found 1200.5"},
      {"/frames/1/height", -3, "frames[1].height: expected an integer from 1 to 100000, found -3"},
      {"/frames/1/height", gone,
       "frames[1].height: expected an integer from 1 to 100000, found nothing"},
      {"/frames/0/frame_id", -1, "frames[0].frame_id: expected an integer >= 0, found -1"},
      {"/frames/0/gain_db", nullptr, "frames[0].gain_db: expected a number, found null"},
      {"/frames/0/xxh3", "xyz", "frames[0].xxh3: expected 16 hexadecimal digits, found \"xyz\""},
      {"/frames/0/camera", "",
       "frames[0].camera: expected a camera's name, but it is empty, found \"\""},
      {"/frames/0/camera", "a/b",
       "frames[0].camera: expected a camera's name, but it has a slash, found \"a/b\""},
      {"/frames/0/file", "/etc/passwd",
       "frames[0].file: expected a path below the frame set's folder, but it is an absolute path, "
       "found \"/etc/passwd\""},
      {"/frames/0/file", "frames/../../x.png",
       "frames[0].file: expected a path below the frame set's folder, but it leads out of the "
       "folder, found \"frames/../../x.png\""},
      {"/frames/0/file", "a\nb.png",
       "frames[0].file: expected a path below the frame set's folder, but it has control "
       "characters, found \"a\\nb.png\""},
      {"/frames/0/file", "frames/",
       "frames[0].file: expected a path below the frame set's folder, but it names a folder, found "
       "\"frames/\""},
      {"/frames/2/camera", "c00r0",
       "frames[2].camera: camera \"c00r0\" is already frames[0]; expected one frame a camera"},
      {"/frames/2/file", "frames//c00r1.png",
       "frames[2].file: \"frames//c00r1.png\" is already the picture of camera \"c00r1\""},
  };
  for (const BadField& bad : table) {
    json text = Parsed(MakeSet());
    const json::json_pointer pointer(bad.pointer);
    if (bad.value.is_discarded()) {
      text[pointer.parent_pointer()].erase(pointer.back());
    } else {
      text[pointer] = bad.value;
    }
    EXPECT_EQ(ErrorOf(text), std::string("frameset.json: ") + bad.error);
  }
}

TEST(FrameSetJson, OneCameraAtTwoSizesNamesBoth) {
  json text = Parsed(MakeSet());
  text["frames"][2]["camera"] = "c00r0";
  text["frames"][2]["width"] = 1600;
  text["frames"][2]["height"] = 1200;
  EXPECT_EQ(ErrorOf(text),
            "frameset.json: frames[2].camera: camera \"c00r0\" occurs with two sizes, 1200x1600 in "
            "frames[0] and 1600x1200 here");
}

TEST(FrameSetJson, RefusesWhatIsNotPlainJson) {
  const auto error = [](const std::string& text) {
    const auto set = FrameSetFromJson(text, "frameset.json");
    return set.ok() ? "ok" : set.error().ToString();
  };
  const std::string text = FrameSetToJson(MakeSet());
  EXPECT_NE(
      error(text.substr(0, text.size() / 2)).find("frameset.json: is not JSON: parse error at"),
      std::string::npos);
  EXPECT_NE(error("").find("is not JSON"), std::string::npos);
  EXPECT_NE(error(text + "x").find("is not JSON"), std::string::npos);
  EXPECT_NE(error("{\"id\": \"\xff\"}").find("is not JSON"), std::string::npos);
  EXPECT_EQ(error("{\"id\": \"a\", \"id\": \"b\"}"),
            "frameset.json: the key \"id\" occurs twice in one object");
  EXPECT_EQ(error(std::string(100000, '[')), "frameset.json: nested deeper than 32 levels");
  EXPECT_EQ(error("[]"), "frameset.json: expected an object, found an array of 0");
}

TEST(ReadFrameSet, ReadsTheManifest) {
  const TemporaryFolder folder;
  const FrameSet set = MakeSet();
  std::ofstream(folder / "frameset.json") << FrameSetToJson(set);
  for (const Frame& frame : set.frames) Touch(folder / frame.file);
  const auto read = ReadFrameSet(folder.path());
  ASSERT_TRUE(read.ok()) << read.error().ToString();
  ExpectSame(*read, set);
  EXPECT_FALSE(read->plain_folder);
  EXPECT_EQ(read->PicturePath(ImageId(1)), folder / "frames/c00r1.png");

  fs::remove(folder / "frames/c01r0.png");
  const auto broken = ReadFrameSet(folder.path());
  ASSERT_FALSE(broken.ok());
  EXPECT_EQ(broken.error().ToString(), (folder / "frameset.json").string() +
                                           ": camera \"c01r0\" is listed as ok, but its file "
                                           "\"frames/c01r0.png\" is not there; a frame with "
                                           "\"status\": \"missing\" in frameset.json is left out");
}

TEST(ReadFrameSet, TakesAPlainFolderOfPictures) {
  const TemporaryFolder folder;
  for (const char* name : {"b.JPG", "a.png", "c.v2.tiff", "notes.txt", ".hidden.png"}) {
    Touch(folder / name);
  }
  fs::create_directory(folder / "z.png");
  const auto set = ReadFrameSet(folder.path() / "");
  ASSERT_TRUE(set.ok()) << set.error().ToString();
  EXPECT_TRUE(set->plain_folder);
  EXPECT_EQ(set->id, folder.path().filename());
  ASSERT_EQ(set->frames.size(), 3u);
  EXPECT_EQ(set->frames[0].camera, "a");
  EXPECT_EQ(set->frames[1].camera, "b");
  EXPECT_EQ(set->frames[1].file, "b.JPG");
  EXPECT_EQ(set->frames[2].camera, "c.v2");
  EXPECT_EQ(set->frames[0].width_px, 0);
}

TEST(ReadFrameSet, LooksIntoImagesAndFrames) {
  for (const std::string below : {"images", "frames"}) {
    const TemporaryFolder folder;
    Touch(folder / (below + "/a.png"));
    const auto set = ReadFrameSet(folder.path());
    ASSERT_TRUE(set.ok()) << set.error().ToString();
    EXPECT_EQ(set->PicturePath(ImageId(0)), folder / (below + "/a.png"));
  }
}

TEST(ReadFrameSet, SortsByCameraNotByFile) {
  const TemporaryFolder folder;
  Touch(folder / "a-1.png");  // '-' sorts before '.', so the files' order is the other one
  Touch(folder / "a.png");
  const auto set = ReadFrameSet(folder.path());
  ASSERT_TRUE(set.ok());
  EXPECT_EQ(set->frames[0].camera, "a");
  EXPECT_EQ(set->frames[1].camera, "a-1");
}

TEST(ReadFrameSet, SaysWhatIsWrongWithAFolder) {
  const TemporaryFolder folder;
  const auto error = [](const fs::path& path) {
    const auto set = ReadFrameSet(path);
    return set.ok() ? "ok" : set.error().ToString();
  };
  EXPECT_EQ(ReadFrameSet(folder / "none").error().code, ErrorCode::kNotFound);
  EXPECT_EQ(error(folder / "none"), (folder / "none").string() + ": no such folder");
  EXPECT_EQ(error(folder.path()),
            folder.path().string() +
                ": expected frameset.json or pictures (png, jpg, tif, bmp, ppm, pgm), found none");
  Touch(folder / "a.png");
  EXPECT_EQ(error(folder / "a.png"),
            (folder / "a.png").string() +
                ": expected a frame set's folder or a folder of pictures, found a file");
  Touch(folder / "a.jpg");
  EXPECT_EQ(error(folder.path()), folder.path().string() +
                                      ": camera \"a\" has two pictures, \"a.jpg\" and \"a.png\"; "
                                      "expected one a camera");
  fs::remove(folder / "a.jpg");
  fs::create_symlink("nowhere", folder / "b.png");
  EXPECT_EQ(error(folder.path()), (folder / "b.png").string() + ": is a link that leads nowhere");
  fs::remove(folder / "b.png");
  Touch(folder / "b\xff.png");
  EXPECT_NE(error(folder.path()).find("expected a file name of printable UTF-8"),
            std::string::npos);
}

}  // namespace
}  // namespace rotunda
