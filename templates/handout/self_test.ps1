# Does this computer get into the VPN, and if not, why? For Windows PowerShell 5.1 and later:
#
#     powershell -ExecutionPolicy Bypass -File self-test.ps1
#
# Start the tunnel first, with OpenVPN GUI or OpenVPN Connect. The test reads self-test.json and the profile, which lie
# beside it, and sends pings through the VPN alone. It ends in PASS, or says what is wrong and what to do.
# Exit code 0: PASS; 6: something failed, or could not be tested. Checked by its grammar alone: we had no Windows.

$ErrorActionPreference = 'Stop'
$wrong = ''
$remedy = ''

function Write-Step([string]$verdict, [string]$step, [string]$found, [string]$do) {
    Write-Host ('  {0,-4}  {1,-8}{2}' -f $verdict, $step, $found)
    if (($verdict -eq 'FAIL') -and ($script:wrong -eq '')) {
        $script:wrong = $step + ': ' + $found
        $script:remedy = $do
    }
}

function Test-Echo([string]$address, [int]$size) {
    $ping = New-Object System.Net.NetworkInformation.Ping
    foreach ($attempt in 1, 2) {
        try {
            if ($ping.Send($address, 4000, (New-Object byte[] $size)).Status -eq 'Success') { return $true }
        } catch {
            continue
        }
    }
    return $false
}

function Get-Time([long]$seconds) {
    return [DateTimeOffset]::FromUnixTimeSeconds($seconds).ToString('yyyy-MM-dd HH:mm') + ' UTC'
}

$facts = Get-Content -Raw -Encoding UTF8 -Path (Join-Path $PSScriptRoot 'self-test.json') | ConvertFrom-Json
Write-Host ('Self-test of ' + $facts.name + ', VPN of ' + $facts.pilot)

$now = [DateTimeOffset]::UtcNow.ToUnixTimeSeconds()
if ($now -lt $facts.not_before) {
    $found = 'this computer''s clock says ' + (Get-Time $now) + ', which is before the certificate begins'
    Write-Step 'FAIL' 'clock' $found 'Set the clock.'
} elseif ($now -gt $facts.not_after) {
    $found = 'by this computer''s clock the certificate has expired on ' + (Get-Time $facts.not_after)
    Write-Step 'FAIL' 'clock' $found 'If the clock is right, ask the control centre to renew this device.'
} else {
    Write-Step 'ok' 'clock' ((Get-Time $now) + '; the certificate is good until ' + (Get-Time $facts.not_after)) ''
}

$path = Join-Path $PSScriptRoot $facts.profile
if (Test-Path -Path $path) {
    $text = [IO.File]::ReadAllText($path).Replace("`r`n", "`n")
    $hash = [Security.Cryptography.SHA256]::Create().ComputeHash([Text.Encoding]::UTF8.GetBytes($text))
    if ([BitConverter]::ToString($hash).Replace('-', '').ToLower() -eq $facts.profile_sha256) {
        Write-Step 'ok' 'profile' 'whole' ''
    } else {
        Write-Step '?' 'profile' 'not as it was handed out: somebody has changed it' ''
    }
} else {
    Write-Step '?' 'profile' ($facts.profile + ' is not beside the test any more') ''
}

$addresses = [System.Net.NetworkInformation.NetworkInterface]::GetAllNetworkInterfaces() |
    ForEach-Object { $_.GetIPProperties().UnicastAddresses } |
    ForEach-Object { $_.Address.ToString() }
$answered = $false
if ($addresses -contains $facts.address) {
    Write-Step 'ok' 'tunnel' ('an interface of this computer has this device''s address ' + $facts.address) ''
    $answered = Test-Echo $facts.server 56
    if ($answered) {
        Write-Step 'ok' 'server' ($facts.server + ' responds') ''
        if (-not (Test-Echo $facts.server 1200)) {
            $found = 'small packets are answered, and packets of 1200 bytes, as DDS sends them, are not'
            Write-Step 'FAIL' 'size' $found 'Ask the network''s administrator to let large UDP packets pass.'
        }
        foreach ($other in $facts.ping) {
            if (Test-Echo $other[1] 56) {
                Write-Step 'ok' 'reach' ($other[0] + ' (' + $other[1] + ') responds') ''
            } else {
                Write-Step '?' 'reach' ($other[0] + ' (' + $other[1] + ') does not respond; it may be off') ''
            }
        }
    } else {
        $found = 'this device has its address in the VPN, and the server (' + $facts.server + ') does not respond'
        Write-Step 'FAIL' 'server' $found 'Connect again, wait a minute, then ask the control centre.'
    }
} else {
    $found = 'no interface of this computer has this device''s address ' + $facts.address
    Write-Step 'FAIL' 'tunnel' $found 'Choose Connect in OpenVPN GUI, then run the test again; View Log tells more.'
}

if ($answered -and ($wrong -eq '')) {
    Write-Host ('PASS: ' + $facts.name + ' is in the VPN.')
    exit 0
}
Write-Host 'NOT PASSED'
Write-Host ('What is wrong: ' + $wrong + '.')
Write-Host ('What to do: ' + $remedy)
Write-Host ('Control centre: ' + $facts.contact)
exit 6
