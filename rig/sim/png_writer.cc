#include "rig/sim/png_writer.h"

#include <spng.h>

#include <cstdlib>
#include <memory>

namespace rotunda::sim {

Result<std::string> EncodePng(const Picture& picture) {
  // Noise does not compress: level 1 with one cheap filter costs a tenth of the default's time for
  // files 3 % larger.
  constexpr int kZlibLevel = 1;
  const std::unique_ptr<spng_ctx, void (*)(spng_ctx*)> context(spng_ctx_new(SPNG_CTX_ENCODER),
                                                               &spng_ctx_free);
  if (!context) return Error{ErrorCode::kFailed, "no memory for the PNG encoder", "PNG"};
  const auto failed = [](const char* what, int code) {
    return Error{ErrorCode::kFailed, std::string(what) + ": " + spng_strerror(code), "PNG"};
  };
  spng_set_option(context.get(), SPNG_ENCODE_TO_BUFFER, 1);
  spng_set_option(context.get(), SPNG_IMG_COMPRESSION_LEVEL, kZlibLevel);
  spng_set_option(context.get(), SPNG_FILTER_CHOICE, SPNG_FILTER_CHOICE_UP);
  spng_ihdr header = {};
  header.width = static_cast<uint32_t>(picture.width);
  header.height = static_cast<uint32_t>(picture.height);
  header.bit_depth = 8;
  header.color_type = SPNG_COLOR_TYPE_TRUECOLOR;
  if (int code = spng_set_ihdr(context.get(), &header)) return failed("header", code);
  if (int code = spng_encode_image(context.get(), picture.rgb.data(), picture.rgb.size(),
                                   SPNG_FMT_PNG, SPNG_ENCODE_FINALIZE)) {
    return failed("encoding", code);
  }
  size_t size = 0;
  int code = 0;
  const std::unique_ptr<void, void (*)(void*)> bytes(
      spng_get_png_buffer(context.get(), &size, &code), &std::free);
  if (!bytes) return failed("buffer", code);
  return std::string(static_cast<const char*>(bytes.get()), size);
}

}  // namespace rotunda::sim
