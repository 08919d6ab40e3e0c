"""Structs, enums and functions of libsaltus, for ctypes. Written by generate.py from include/saltus; do not edit."""
# fmt: off
from ctypes import CFUNCTYPE, Structure, c_bool, c_char, c_char_p, c_double, c_float, c_int, c_int32, c_size_t, c_uint32, c_uint64, c_uint8, c_void_p

SLT_EST_LATTICE = 0
SLT_EST_SCANLINE = 1
SLT_EST_SNAP_KNN = 2
SLT_EST_SNAP_CROFTON = 3
SLT_EST_FD = 4
SLT_EST_QUADRATURE = 5
SLT_EST_AUTO = 6
SLT_ESTIMATORS = 7
SLT_FILTER_BOX = 0
SLT_FILTER_TENT = 1
SLT_FILTER_GAUSSIAN = 2
SLT_INTERIOR_AUTO = 0
SLT_INTERIOR_SAMPLES = 1
SLT_INTERIOR_QUADRATURE = 2
SLT_GAUSS_MAX = 16
SLT_DROP_ZERO_GRADIENT = 0
SLT_DROP_NOT_FINITE = 1
SLT_DROP_INCONSISTENT = 2
SLT_DROP_NO_EVENT = 3
SLT_DROP_NO_ROOT = 4
SLT_DROP_STATIC = 5
SLT_DROP_HALVINGS = 6
SLT_DROP_COINCIDENT = 7
SLT_DROP_REASONS = 8
SLT_STOP_NONE = 0
SLT_STOP_EVALUATIONS = 1
SLT_STOP_ROUNDING = 2
SLT_FEW_ULPS = 32
SLT_BOUND_OPEN = 8
SLT_OK = 0
SLT_CHECK_FAILED = 1
SLT_USAGE = 2
SLT_PROGRAM = 3
SLT_INPUT = 4
SLT_OUTPUT = 5
SLT_LIMIT = 6
SLT_STOPPED = 7
SLT_INTERNAL = 70
SLT_INTERRUPTED = 130
SLT_STRUCTURE_AUTO = 0
SLT_STRUCTURE_MIPMAP = 1
SLT_STRUCTURE_CONE = 2
SLT_STRUCTURE_NAIVE = 3
SLT_LANGUAGE_AUTO = 0
SLT_LANGUAGE_SALTUS = 1
SLT_LANGUAGE_GLSL = 2
SLT_KIND_FLOAT = 0
SLT_KIND_BOOL = 1
SLT_KIND_INT = 2
SLT_KIND_UINT = 3
SLT_KIND_STRUCT = 4
SLT_MAX_RANK = 8
SLT_FIT_L2 = 0
SLT_FIT_L1 = 1
SLT_FIT_HUBER = 2
SLT_FIT_CONSTANT = 0
SLT_FIT_EXPONENTIAL = 1
SLT_FIT_COSINE = 2
SLT_FIT_RUNNING = 0
SLT_FIT_ITERATIONS = 1
SLT_FIT_CONVERGED = 2
SLT_FIT_STOPPED = 3
SLT_FIT_INTERRUPTED = 4
SLT_FIT_TIME_LIMIT = 5
SLT_FIT_FAILED = 6
SltPrint = CFUNCTYPE(None, c_void_p, c_char_p, c_void_p, c_uint32)
SltFitLoss = CFUNCTYPE(c_int, c_void_p, c_void_p, c_void_p, c_void_p, c_void_p)
SltFitIterated = CFUNCTYPE(c_bool, c_void_p, c_void_p)
SltJobProgress = CFUNCTYPE(None, c_void_p, c_double)


class SltJob(Structure):
    _fields_ = [
        ("struct_size", c_size_t),
        ("integral", c_bool),
        ("size", c_uint32 * 3),
        ("spp", c_uint32),
        ("samples", c_uint64),
        ("segments", c_uint64),
        ("filter", c_int),
        ("seed", c_uint32),
        ("threads", c_uint32),
        ("estimator", c_int),
        ("no_interior", c_bool),
        ("no_boundary", c_bool),
        ("replicates", c_uint32),
        ("fd_step", c_double),
        ("time_limit", c_double),
        ("cancel", c_void_p),
        ("progress", SltJobProgress),
        ("progress_user", c_void_p),
        ("floats", c_void_p),
        ("ints", c_void_p),
        ("interior", c_int),
        ("gauss", c_uint32),
        ("error", c_double),
        ("abs_error", c_double),
        ("max_evaluations", c_uint64),
        ("centred", c_bool),
    ]


class SltPlace(Structure):
    _fields_ = [
        ("known", c_bool),
        ("in_image", c_bool),
        ("site", c_uint32),
        ("line", c_uint32),
        ("column", c_uint32),
        ("pixel", c_uint32 * 3),
        ("file", c_char_p),
        ("text", c_char_p),
        ("x", c_double * 3),
        ("beyond", c_double * 3),
        ("stream", c_int32),
        ("rand0", c_double),
    ]


class SltStats(Structure):
    _fields_ = [
        ("struct_size", c_size_t),
        ("samples", c_uint64),
        ("segments", c_uint64),
        ("crossings", c_uint64),
        ("evaluations", c_uint64),
        ("dropped", c_uint64 * 8),
        ("truncated", c_uint64),
        ("asserts", c_uint64),
        ("nonfinite", c_uint64),
        ("seconds", c_double),
        ("seconds_interior", c_double),
        ("seconds_boundary", c_double),
        ("cells", c_bool),
        ("certified", c_double),
        ("settled", c_double),
        ("curved", c_double),
        ("left", c_double),
        ("left_bound", c_double),
        ("boxes", c_uint64),
        ("stopped", c_int),
        ("upset", c_double),
        ("upset_line", c_uint32),
        ("ulps", c_double),
        ("dropped_at", SltPlace * 8),
        ("nonfinite_at", SltPlace),
        ("singular", c_double),
        ("out_of_range", c_int),
        ("out_of_range_at", SltPlace),
        ("unmet", c_uint64),
        ("unmet_at", SltPlace),
        ("blind", c_uint32),
        ("blind_at", SltPlace),
    ]


class SltWarning(Structure):
    _fields_ = [
        ("struct_size", c_size_t),
        ("severity", c_int),
        ("code", c_char_p),
        ("at", SltPlace),
        ("text", c_char * 1024),
    ]


class SltIntegral(Structure):
    _fields_ = [
        ("struct_size", c_size_t),
        ("value", c_void_p),
        ("value_stderr", c_void_p),
        ("gradient", c_void_p),
        ("gradient_stderr", c_void_p),
        ("interior", c_void_p),
        ("boundary", c_void_p),
        ("missed_estimate", c_void_p),
        ("replicates", c_bool),
        ("mixed", c_bool),
        ("left_bound", c_void_p),
    ]


class SltCrossing(Structure):
    _fields_ = [
        ("struct_size", c_size_t),
        ("found", c_bool),
        ("x", c_double * 3),
        ("t", c_double),
        ("g", c_double),
        ("dg", c_double * 3),
        ("f_before", c_double * 4),
        ("f_after", c_double * 4),
        ("site", c_int32),
        ("k", c_int32 * 8),
        ("drop", c_int),
    ]


class SltOpenEvent(Structure):
    _fields_ = [
        ("edge", c_int32),
        ("loops", c_uint32),
        ("k", c_int32 * 8),
        ("kind", c_char_p),
        ("file", c_char_p),
        ("text", c_char_p),
        ("line", c_uint32),
        ("column", c_uint32),
        ("g", c_double * 2),
        ("dg", ((c_double * 2) * 3)),
        ("boundary", c_double * 2),
        ("seam", c_bool),
        ("jumps", c_bool),
        ("bends", c_bool),
    ]


class SltBound(Structure):
    _fields_ = [
        ("struct_size", c_size_t),
        ("settled", c_bool),
        ("unknown", c_bool),
        ("rough", c_bool),
        ("count", c_uint32),
        ("listed", c_uint32),
        ("open", SltOpenEvent * 8),
        ("lo", c_double * 4),
        ("hi", c_double * 4),
    ]


class SltError(Structure):
    _fields_ = [
        ("status", c_int),
        ("text", c_char * 512),
    ]


class SltSet(Structure):
    _fields_ = [
        ("name", c_char_p),
        ("value", c_char_p),
    ]


class SltOptions(Structure):
    _fields_ = [
        ("struct_size", c_size_t),
        ("entry", c_char_p),
        ("set", c_void_p),
        ("nset", c_uint32),
        ("param_files", c_void_p),
        ("nparam_files", c_uint32),
        ("import_dirs", c_void_p),
        ("nimport_dirs", c_uint32),
        ("stdlib_dir", c_char_p),
        ("f64", c_bool),
        ("disc_auto", c_bool),
        ("seed", c_uint32),
        ("width", c_uint32),
        ("interpret", c_bool),
        ("no_cache", c_bool),
        ("target", c_char_p),
        ("near_miss", c_int),
        ("rgba8", c_bool),
        ("paper_argmin", c_bool),
        ("paper_forced", c_bool),
        ("path_hash", c_bool),
        ("dump", c_char_p),
        ("verify", c_bool),
        ("field", c_int),
        ("verify_after", c_char_p),
        ("stop_after", c_char_p),
        ("sandbox", c_bool),
        ("language", c_int),
        ("size", c_uint32 * 2),
        ("lengths", c_char_p),
    ]


class SltDiagnostic(Structure):
    _fields_ = [
        ("struct_size", c_size_t),
        ("severity", c_int),
        ("code", c_char_p),
        ("message", c_char_p),
        ("file", c_char_p),
        ("line", c_uint32),
        ("column", c_uint32),
    ]


class SltParam(Structure):
    _fields_ = [
        ("struct_size", c_size_t),
        ("name", c_char_p),
        ("type", c_char_p),
        ("fbase", c_uint32),
        ("fcount", c_uint32),
        ("ibase", c_uint32),
        ("icount", c_uint32),
        ("differentiable", c_bool),
        ("is_texture", c_bool),
        ("is_heightfield", c_bool),
        ("has_range", c_bool),
        ("log", c_bool),
        ("color", c_bool),
        ("lo", c_double),
        ("hi", c_double),
        ("doc", c_char_p),
        ("tex_w", c_uint32),
        ("tex_h", c_uint32),
        ("tex_c", c_uint32),
        ("kind", c_int),
        ("rank", c_uint32),
        ("shape", c_uint32 * 8),
        ("fstride", c_uint32),
        ("istride", c_uint32),
        ("nfields", c_uint32),
        ("layout", c_void_p),
        ("has_extent", c_bool),
        ("extent", c_double * 4),
        ("height_scale", c_double),
        ("height_offset", c_double),
        ("tex_d", c_uint32),
    ]


class SltFitView(Structure):
    _fields_ = [
        ("struct_size", c_size_t),
        ("target", c_void_p),
        ("mask", c_void_p),
        ("values", c_void_p),
        ("nvalues", c_uint32),
        ("program", c_void_p),
    ]


class SltFitNumber(Structure):
    _fields_ = [
        ("name", c_char_p),
        ("value", c_double),
    ]


class SltFitMask(Structure):
    _fields_ = [
        ("name", c_char_p),
        ("width", c_uint32),
        ("height", c_uint32),
        ("factors", c_void_p),
    ]


class SltFitRequest(Structure):
    _fields_ = [
        ("struct_size", c_size_t),
        ("iteration", c_uint32),
        ("view", c_uint32),
        ("views", c_uint32),
        ("pixels", c_uint32 * 3),
        ("channels", c_uint32),
        ("image", c_void_p),
    ]


class SltFitIteration(Structure):
    _fields_ = [
        ("struct_size", c_size_t),
        ("iteration", c_uint32),
        ("count", c_uint32),
        ("index", c_void_p),
        ("parameters", c_void_p),
        ("gradient", c_void_p),
        ("loss", c_double),
        ("best", c_double),
        ("image", c_void_p),
    ]


class SltFitOptions(Structure):
    _fields_ = [
        ("struct_size", c_size_t),
        ("job", c_void_p),
        ("views", c_void_p),
        ("nviews", c_uint32),
        ("loss", SltFitLoss),
        ("loss_user", c_void_p),
        ("loss_name", c_char_p),
        ("minimize", c_bool),
        ("optimizer", c_char_p),
        ("iterations", c_uint32),
        ("rates", c_void_p),
        ("nrates", c_uint32),
        ("rate_masks", c_void_p),
        ("nrate_masks", c_uint32),
        ("smooth", c_void_p),
        ("nsmooth", c_uint32),
        ("beta1", c_double),
        ("beta2", c_double),
        ("epsilon", c_double),
        ("momentum", c_double),
        ("history", c_uint32),
        ("gradient_tolerance", c_double),
        ("loss_tolerance", c_double),
        ("patience", c_uint32),
        ("max_failures", c_uint32),
        ("checkpoint", c_char_p),
        ("every", c_uint32),
        ("resume", c_char_p),
        ("iterated", SltFitIterated),
        ("iterated_user", c_void_p),
        ("stats", c_void_p),
        ("metric", c_int),
        ("huber_delta", c_double),
        ("loss_entry", c_char_p),
        ("schedule", c_int),
        ("views_per_step", c_uint32),
        ("decay", c_double),
        ("smooth_faces", c_void_p),
        ("nsmooth_faces", c_uint32),
        ("first", c_uint32),
        ("planned", c_uint32),
        ("smooth_grids", c_void_p),
        ("nsmooth_grids", c_uint32),
    ]


class SltFitResult(Structure):
    _fields_ = [
        ("struct_size", c_size_t),
        ("stop", c_int),
        ("iterations", c_uint32),
        ("initial_loss", c_double),
        ("loss", c_double),
        ("losses", c_void_p),
        ("reason", c_char * 512),
    ]


ESTIMATORS = {'lattice': 0, 'scanline': 1, 'snap-knn': 2, 'snap-crofton': 3, 'fd': 4, 'quadrature': 5, 'auto': 6}
INITIAL = {  # what the _INIT macros set, beside the size
    SltJob: {'size': (512, 512, 1), 'spp': 4, 'estimator': 6},
    SltStats: {},
    SltWarning: {},
    SltIntegral: {},
    SltCrossing: {},
    SltBound: {},
    SltOptions: {'near_miss': -1},
    SltDiagnostic: {},
    SltParam: {},
    SltFitView: {},
    SltFitOptions: {'iterations': 200, 'every': 10},
    SltFitResult: {},
}

FUNCTIONS = {  # name: what it returns, what it takes
    "slt_compile_file": (c_int, [c_char_p, c_void_p, c_void_p]),
    "slt_compile_string": (c_int, [c_char_p, c_char_p, c_void_p, c_void_p]),
    "slt_program_free": (None, [c_void_p]),
    "slt_version": (c_char_p, []),
    "slt_diagnostic_count": (c_uint32, [c_void_p]),
    "slt_diagnostic": (c_bool, [c_void_p, c_uint32, c_void_p]),
    "slt_diagnostics_text": (c_char_p, [c_void_p]),
    "slt_diagnostics_json": (c_char_p, [c_void_p]),
    "slt_last_error": (c_char_p, [c_void_p]),
    "slt_dim": (c_uint32, [c_void_p]),
    "slt_channels": (c_uint32, [c_void_p]),
    "slt_entry": (c_char_p, [c_void_p]),
    "slt_is_display": (c_bool, [c_void_p]),
    "slt_domain": (None, [c_void_p, c_void_p, c_void_p]),
    "slt_site_count": (c_uint32, [c_void_p]),
    "slt_uses_rand": (c_bool, [c_void_p]),
    "slt_param_count": (c_uint32, [c_void_p]),
    "slt_param": (c_bool, [c_void_p, c_uint32, c_void_p]),
    "slt_param_field": (c_bool, [c_void_p, c_uint32, c_void_p]),
    "slt_param_find": (c_int, [c_void_p, c_char_p, c_void_p, c_void_p]),
    "slt_mesh": (c_void_p, [c_void_p, c_uint32, c_void_p, c_void_p]),
    "slt_float_count": (c_uint32, [c_void_p]),
    "slt_int_count": (c_uint32, [c_void_p]),
    "slt_floats": (c_void_p, [c_void_p]),
    "slt_ints": (c_void_p, [c_void_p]),
    "slt_set_floats": (c_int, [c_void_p, c_uint32, c_uint32, c_void_p, c_void_p]),
    "slt_set_ints": (c_int, [c_void_p, c_uint32, c_uint32, c_void_p, c_void_p]),
    "slt_set_text": (c_int, [c_void_p, c_char_p, c_char_p, c_void_p]),
    "slt_params_json": (c_void_p, [c_void_p]),
    "slt_set_params_json": (c_int, [c_void_p, c_char_p, c_char_p, c_void_p]),
    "slt_wrt": (c_int, [c_void_p, c_void_p, c_uint32, c_void_p]),
    "slt_wrt_mask": (c_void_p, [c_void_p]),
    "slt_set_print": (c_int, [c_void_p, SltPrint, c_void_p, c_void_p]),
    "slt_render": (c_int, [c_void_p, c_void_p, c_void_p, c_void_p, c_void_p]),
    "slt_render_rgba8": (c_int, [c_void_p, c_void_p, c_void_p, c_void_p, c_void_p]),
    "slt_grad_images": (c_int, [c_void_p, c_void_p, c_uint32, c_void_p, c_void_p, c_void_p, c_void_p, c_void_p]),
    "slt_grad_adjoint": (c_int, [c_void_p, c_void_p, c_void_p, c_void_p, c_void_p, c_void_p, c_void_p]),
    "slt_grad_loss": (c_int, [c_void_p, c_void_p, c_void_p, c_void_p, c_void_p, c_void_p, c_void_p, c_void_p, c_void_p, c_void_p]),
    "slt_grad_integral": (c_int, [c_void_p, c_void_p, c_void_p, c_void_p, c_void_p]),
    "slt_warning": (c_bool, [c_void_p, c_uint32, c_void_p]),
    "slt_eval": (c_int, [c_void_p, c_void_p, c_uint64, c_void_p, c_void_p, c_void_p, c_void_p, c_void_p]),
    "slt_crossing": (c_int, [c_void_p, c_void_p, c_void_p, c_void_p, c_uint32, c_void_p, c_void_p]),
    "slt_bound": (c_int, [c_void_p, c_void_p, c_uint32, c_void_p, c_void_p, c_void_p, c_void_p]),
    "slt_fit_optimizer": (c_char_p, [c_uint32]),
    "slt_fit": (c_int, [c_void_p, c_void_p, c_void_p, c_void_p]),
    "slt_fit_begin": (c_int, [c_void_p, c_void_p, c_void_p, c_void_p]),
    "slt_fit_step": (c_int, [c_void_p, c_void_p, c_void_p]),
    "slt_fit_image": (c_int, [c_void_p, c_uint32, c_bool, c_void_p, c_void_p, c_void_p]),
    "slt_fit_end": (c_int, [c_void_p, c_void_p, c_void_p]),
    "slt_image_read": (c_int, [c_char_p, c_bool, c_void_p, c_void_p, c_void_p, c_void_p]),
    "slt_image_write": (c_int, [c_char_p, c_bool, c_void_p, c_uint32, c_void_p, c_void_p]),
    "slt_image_encode": (c_int, [c_char_p, c_bool, c_void_p, c_uint32, c_void_p, c_void_p, c_void_p, c_void_p]),
    "slt_image_encode_signed": (c_int, [c_double, c_char_p, c_void_p, c_uint32, c_void_p, c_void_p, c_void_p, c_void_p]),
}
