% Adapter: n4sid of Octave's control package, with its default horizon and with 25 block rows.
% octave-cli octave_fit.m CASE.json MODELS.json; what the files hold is said in protocol.py.

1;

function [model, seconds] = identify (case_, options)
  start = cputime ();
  data = iddata (case_.output, case_.inputs, case_.sample_period_s);
  model = n4sid (data, case_.order, options{:});
  seconds = cputime () - start;
endfunction

function entry = attempt (case_, variant, options)
  entry.variant = variant;
  try
    [model, entry.first_seconds] = identify (case_, options);
    later = [];
    while (numel (later) < 5 && sum (later) < 2)
      [~, later(end + 1)] = identify (case_, options);
    endwhile
    entry.seconds = min (later);
    [A, B, C, D] = ssdata (model);
    % A scalar or a single row would lose its brackets in JSON, so the shapes travel beside the numbers.
    entry.A = num2cell (A, 2); entry.B = num2cell (B, 2); entry.C = num2cell (C, 2); entry.D = num2cell (D, 2);
  catch problem
    entry.error = problem.message;
  end_try_catch
endfunction

function main (source, target)
  pkg load control
  case_ = jsondecode (fileread (source));
  models = {attempt(case_, "default s", {}), attempt(case_, "s = 25", {"s", 25})};
  file = fopen (target, "w");
  fputs (file, jsonencode (models));
  fclose (file);
endfunction

arguments = argv ();
main (arguments{end - 1}, arguments{end});
