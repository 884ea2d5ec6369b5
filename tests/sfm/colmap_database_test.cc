#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <functional>

#include "sfm/colmap_io.h"
#include "sfm/core/file_io.h"
#include "tests/support/colmap_database_writer.h"
#include "tests/support/process.h"

namespace rotunda::sfm {
namespace {

namespace fs = std::filesystem;
using test::ColmapDatabaseWriter;
using test::ColmapPairId;
using test::RunProcess;
using test::TemporaryFolder;

/// Frames a, b, c; in the database c has id 1 and a has id 3.
FrameSet MakeSet() {
  FrameSet set;
  for (const std::string camera : {"a", "b", "c"}) {
    Frame frame;
    frame.camera = camera;
    frame.file = "frames/";
    frame.file += camera + ".png";
    set.frames.push_back(frame);
  }
  return set;
}

void PutImages(ColmapDatabaseWriter& writer) {
  writer.Run(
      "INSERT INTO cameras VALUES (7, 4, 1200, 1600, x'00', 0);"
      "INSERT INTO images (image_id, name, camera_id) VALUES (1, 'frames/c.png', 7);"
      "INSERT INTO images (image_id, name, camera_id) VALUES (2, 'b.png', 7);"
      "INSERT INTO images (image_id, name, camera_id) VALUES (3, 'frames/a.png', 7);"
      "INSERT INTO images (image_id, name, camera_id) VALUES (4, 'another.png', 7);");
}

void PutFeatures(ColmapDatabaseWriter& writer) {
  writer.Put<float>("keypoints", 1, 2, 2, {10.5F, 20.5F, 30, 40});
  writer.Put<float>("keypoints", 2, 1, 4, {11, 21, 3.5F, -0.25F});
  const float c = 3 * std::cos(0.7F), s = 3 * std::sin(0.7F);
  writer.Put<float>("keypoints", 3, 3, 6,
                    {1, 2, c, -s, s, c, 3, 4, c, -s, s, c, 5, 6, c, -s, s, c});
  writer.Put<float>("keypoints", 4, 1, 2, {0, 0});
  std::vector<uint8_t> descriptors(3 * kDescriptorSize);
  for (size_t i = 0; i < descriptors.size(); ++i) descriptors[i] = static_cast<uint8_t>(i);
  writer.Put<uint8_t>("descriptors", 3, 3, kDescriptorSize, descriptors);
}

void PutMatches(ColmapDatabaseWriter& writer) {
  writer.Put<uint32_t>("matches", ColmapPairId(1, 3), 2, 2, {1, 0, 0, 2});
  writer.Put<uint32_t>("matches", ColmapPairId(2, 3), 1, 2, {0, 1});
  writer.Put<uint32_t>("matches", ColmapPairId(1, 2), 0, 2, {});
  writer.Put<uint32_t>("matches", ColmapPairId(3, 4), 1, 2, {0, 0});
  writer.Put<uint32_t>("two_view_geometries", ColmapPairId(1, 3), 1, 2, {0, 2});
  writer.Put<uint32_t>("two_view_geometries", ColmapPairId(2, 3), 0, 0, {});
}

TEST(ColmapDatabase, GivesFeaturesAndMatchesOfTheFrames) {
  const TemporaryFolder folder;
  {
    ColmapDatabaseWriter writer(folder / "database.db");
    PutImages(writer);
    PutFeatures(writer);
    PutMatches(writer);
  }
  const auto database = ReadColmapDatabase(folder / "database.db", MakeSet());
  ASSERT_TRUE(database.ok()) << database.error().ToString();
  const auto& images = database->features.images;
  ASSERT_EQ(images.size(), 3u);
  EXPECT_EQ(images[1].width_px, 1200);
  EXPECT_EQ(images[1].height_px, 1600);
  ASSERT_EQ(images[0].keypoints.size(), 3u);
  EXPECT_EQ(images[0].keypoints[2].x_px, 5.0F);
  EXPECT_NEAR(images[0].keypoints[0].scale_px, 3.0F, 1e-6);
  EXPECT_NEAR(images[0].keypoints[0].orientation_rad, 0.7F, 1e-6);
  EXPECT_EQ(images[1].keypoints[0].scale_px, 3.5F);
  EXPECT_EQ(images[1].keypoints[0].orientation_rad, -0.25F);
  ASSERT_EQ(images[2].keypoints.size(), 2u);
  EXPECT_EQ(images[2].keypoints[0].y_px, 20.5F);
  ASSERT_EQ(images[0].descriptors.size(), 3 * kDescriptorSize);
  EXPECT_EQ(images[0].descriptors[130], 130);
  EXPECT_TRUE(images[1].descriptors.empty());

  // COLMAP's image 1 is frame c and 3 is a: a pair (1, 3) becomes (a, c) with its ends exchanged.
  const auto match = [](size_t first, size_t second) {
    return Match{KeypointId(first), KeypointId(second)};
  };
  ASSERT_EQ(database->matches.pairs.size(), 2u);
  const PairMatches& ab = database->matches.pairs[0];
  const PairMatches& ac = database->matches.pairs[1];
  EXPECT_EQ(ab.pair, (ImagePair{ImageId(0), ImageId(1)}));
  EXPECT_EQ(ab.matches, (std::vector<Match>{match(1, 0)}));
  EXPECT_EQ(ac.pair, (ImagePair{ImageId(0), ImageId(2)}));
  EXPECT_EQ(ac.matches, (std::vector<Match>{match(0, 1), match(2, 0)}));
  ASSERT_EQ(database->verified_inliers.pairs.size(), 1u);
  EXPECT_EQ(database->verified_inliers.pairs[0].matches, (std::vector<Match>{match(2, 0)}));
}

TEST(ColmapDatabase, TakesAnOddFileName) {
  const TemporaryFolder folder;
  const fs::path file = folder / "a b?mode=rw#%20\xc3\xa9.db";
  {
    ColmapDatabaseWriter writer(file);
    PutImages(writer);
  }
  const auto database = ReadColmapDatabase(file, MakeSet());
  EXPECT_TRUE(database.ok()) << database.error().ToString();
}

TEST(ColmapDatabase, LeavesTheFileAlone) {
  const TemporaryFolder folder;
  {
    ColmapDatabaseWriter writer(folder / "database.db");
    PutImages(writer);
  }
  const std::string before = *ReadFile(folder / "database.db");
  ASSERT_TRUE(ReadColmapDatabase(folder / "database.db", MakeSet()).ok());
  EXPECT_EQ(*ReadFile(folder / "database.db") == before, true);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), fs::directory_iterator()), 1);
}

struct BadDatabase {
  const char* name;
  std::function<void(ColmapDatabaseWriter&)> change;
  const char* error;  // after the file's name
};

TEST(ColmapDatabase, NamesFileTableAndRow) {
  const std::vector<BadDatabase> table = {
      {"blob",
       [](ColmapDatabaseWriter& w) {
         w.Put<float>("keypoints", 1, 5, 2, {1, 2});
       },
       "keypoints: row 1: data has 8 bytes, expected 5 rows x 2 cols x 4 bytes"},
      {"negative",
       [](ColmapDatabaseWriter& w) {
         w.Put<float>("keypoints", 1, -1, -2, {1, 2});
       },
       "keypoints: row 1: data has 8 bytes, expected -1 rows x -2 cols x 4 bytes"},
      {"overflow",
       [](ColmapDatabaseWriter& w) { w.Put<float>("keypoints", 1, int64_t{1} << 62, 4, {}); },
       "keypoints: row 1: data has 0 bytes, expected 4611686018427387904 rows x 4 cols x 4 bytes"},
      {"cols",
       [](ColmapDatabaseWriter& w) {
         w.Put<float>("keypoints", 1, 1, 3, {1, 2, 3});
       },
       "keypoints: row 1: expected 2, 4 or 6 columns, found 3"},
      {"nan",
       [](ColmapDatabaseWriter& w) {
         w.Put<float>("keypoints", 1, 2, 2, {1, 2, NAN, 4});
       },
       "keypoints: row 1: keypoint 1 is not finite numbers"},
      {"descriptors",
       [](ColmapDatabaseWriter& w) {
         w.Put<uint8_t>("descriptors", 1, 1, 128, std::vector<uint8_t>(128));
       },
       "descriptors: row 1: expected 0 descriptors of 128 bytes, found 1 of 128"},
      {"match",
       [](ColmapDatabaseWriter& w) {
         PutFeatures(w);
         w.Put<uint32_t>("matches", ColmapPairId(1, 3), 1, 2, {1, 3});
       },
       "matches: row 1: match 0 is 1 - 3, but the images have 2 and 3 keypoints"},
      {"columns of matches",
       [](ColmapDatabaseWriter& w) {
         PutFeatures(w);
         w.Put<uint32_t>("matches", ColmapPairId(1, 3), 2, 1, {1, 1});
       },
       "matches: row 1: expected 2 columns, found 1"},
      {"itself",
       [](ColmapDatabaseWriter& w) {
         w.Put<uint32_t>("matches", ColmapPairId(3, 3), 1, 2, {0, 0});
       },
       "matches: row 1: is a pair of one image with itself"},
      {"missing", [](ColmapDatabaseWriter& w) { w.Run("DELETE FROM images WHERE image_id = 2"); },
       "has no image named \"frames/b.png\" (camera \"b\")"},
      {"twice",
       [](ColmapDatabaseWriter& w) {
         w.Run("INSERT INTO images (image_id, name, camera_id) VALUES (9, 'x/b.png', 7)");
       },
       "images: row 5: \"x/b.png\" is the second image for file \"frames/b.png\""},
      {"no camera",
       [](ColmapDatabaseWriter& w) { w.Run("UPDATE images SET camera_id = 1 WHERE image_id = 2"); },
       "images: row 2: \"frames/b.png\" has size 0x0, expected a positive size"},
      {"no table", [](ColmapDatabaseWriter& w) { w.Run("DROP TABLE matches"); },
       "is not a COLMAP database: it has no table matches"},
      {"view",
       [](ColmapDatabaseWriter& w) {
         w.Run(
             "DROP TABLE matches; CREATE VIEW matches AS SELECT 1 AS pair_id, 0 AS rows, 0 AS "
             "cols, NULL AS data");
       },
       "is not a COLMAP database: it has no table matches"},
      {"no column",
       [](ColmapDatabaseWriter& w) { w.Run("ALTER TABLE matches RENAME COLUMN cols TO columns"); },
       "matches: is not COLMAP's: no such column: cols"},
  };
  for (const BadDatabase& bad : table) {
    const TemporaryFolder folder;
    {
      ColmapDatabaseWriter writer(folder / "database.db");
      PutImages(writer);
      bad.change(writer);
    }
    const auto database = ReadColmapDatabase(folder / "database.db", MakeSet());
    ASSERT_FALSE(database.ok()) << bad.name;
    EXPECT_EQ(database.error().code, ErrorCode::kBadInput) << bad.name;
    EXPECT_EQ(database.error().ToString(), (folder / "database.db").string() + ": " + bad.error);
  }
}

TEST(ColmapDatabase, RefusesWhatIsNoDatabase) {
  const TemporaryFolder folder;
  EXPECT_EQ(ReadColmapDatabase(folder / "none.db", MakeSet()).error().code, ErrorCode::kNotFound);
  EXPECT_EQ(ReadColmapDatabase(folder.path(), MakeSet()).error().code, ErrorCode::kNotFound);
  std::ofstream(folder / "text.db") << std::string(5000, 'x');
  const auto text = ReadColmapDatabase(folder / "text.db", MakeSet());
  ASSERT_FALSE(text.ok());
  EXPECT_EQ(text.error().ToString(),
            (folder / "text.db").string() + ": is not a database: file is not a database");
  {
    ColmapDatabaseWriter writer(folder / "open.db");
    PutImages(writer);
  }
  std::ofstream(folder / "open.db-wal") << "log";
  EXPECT_NE(ReadColmapDatabase(folder / "open.db", MakeSet()).error().message.find("write-ahead"),
            std::string::npos);
}

TEST(ColmapDatabase, ChecksTheSizeOfThePictures) {
  const TemporaryFolder folder;
  {
    ColmapDatabaseWriter writer(folder / "database.db");
    PutImages(writer);
  }
  FrameSet set = MakeSet();
  set.frames[0].width_px = 1200;
  set.frames[0].height_px = 1600;
  EXPECT_TRUE(ReadColmapDatabase(folder / "database.db", set).ok());
  set.frames[0].width_px = 1000;
  EXPECT_EQ(ReadColmapDatabase(folder / "database.db", set).error().ToString(),
            (folder / "database.db").string() +
                ": images: row 3: \"frames/a.png\" has size 1200x1600, expected 1000x1600");
}

TEST(ColmapDatabase, AFrameThatIsNotOkNeedsNoImage) {
  const TemporaryFolder folder;
  {
    ColmapDatabaseWriter writer(folder / "database.db");
    PutImages(writer);
  }
  FrameSet set = MakeSet();
  Frame lost;
  lost.camera = "d";
  lost.status = "missing";
  set.frames.push_back(lost);
  const auto database = ReadColmapDatabase(folder / "database.db", set);
  ASSERT_TRUE(database.ok()) << database.error().ToString();
  EXPECT_EQ(database->features.images.size(), 4u);
}

/// A grey picture with a grid of blobs, as plain PGM.
void WriteBlobs(const fs::path& file, int shift) {
  constexpr int kWidth = 400, kHeight = 300;
  std::string text = "P5\n400 300\n255\n";
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      double value = 60;
      for (int k = 0; k < 60; ++k) {
        const double dx = x - (20 + (k * 97) % 360) - shift, dy = y - (20 + (k * 61) % 260);
        value += (60 + 20 * (k % 4)) * std::exp(-(dx * dx + dy * dy) / (8.0 + 3 * (k % 7)));
      }
      text += static_cast<char>(static_cast<uint8_t>(std::min(255.0, value)));
    }
  }
  std::ofstream(file, std::ios::binary) << text;
}

TEST(ColmapDatabase, ReadsADatabaseThatColmapMade) {
  if (RunProcess({"colmap", "help"}).exit_code != 0) GTEST_SKIP() << "colmap is not installed";
  const TemporaryFolder folder;
  fs::create_directory(folder / "images");
  WriteBlobs(folder / "images/a.pgm", 0);
  WriteBlobs(folder / "images/b.pgm", 7);
  const std::string database_file = (folder / "database.db").string();
  const auto extracted =
      RunProcess({"colmap", "feature_extractor", "--database_path", database_file, "--image_path",
                  (folder / "images").string(), "--SiftExtraction.use_gpu", "0"});
  ASSERT_EQ(extracted.exit_code, 0) << extracted.errors;
  const auto matched = RunProcess({"colmap", "exhaustive_matcher", "--database_path", database_file,
                                   "--SiftMatching.use_gpu", "0"});
  ASSERT_EQ(matched.exit_code, 0) << matched.errors;
  const auto set = ReadFrameSet(folder.path());
  ASSERT_TRUE(set.ok()) << set.error().ToString();
  const auto database = ReadColmapDatabase(database_file, *set);
  ASSERT_TRUE(database.ok()) << database.error().ToString();
  const ImageFeatures& first = database->features.images[0];
  EXPECT_EQ(first.width_px, 400);
  EXPECT_GT(first.keypoints.size(), 30u);
  EXPECT_EQ(first.descriptors.size(), first.keypoints.size() * kDescriptorSize);
  ASSERT_EQ(database->verified_inliers.pairs.size(), 1u);
  const PairMatches& pair = database->verified_inliers.pairs[0];
  EXPECT_GT(pair.matches.size(), 20u);
  // Coarser keypoints are made of several blobs and of the border, which does not move with them.
  constexpr float kCoarsestBlob_px = 4.0F;
  size_t blobs = 0;
  for (const Match& match : pair.matches) {
    const Keypoint& a = first.keypoints[match.first.index()];
    const Keypoint& b = database->features.images[1].keypoints[match.second.index()];
    if (a.scale_px > kCoarsestBlob_px) continue;
    ++blobs;
    EXPECT_NEAR(b.x_px - a.x_px, 7.0, 0.05);
    EXPECT_NEAR(b.y_px - a.y_px, 0.0, 0.05);
  }
  EXPECT_GT(blobs, 20u);
}

}  // namespace
}  // namespace rotunda::sfm
